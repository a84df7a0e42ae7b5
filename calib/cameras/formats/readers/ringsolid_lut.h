// A camera as a table of rays: reads camera.lut, which `calib convert CAMERA --to lut` writes. C++17, nothing else.
//
//     ringsolid::Lut lut;
//     std::string error;
//     if (!lut.read("camera.lut", error)) { std::cerr << error; return 1; }
//     double ray[3], pixel[2];
//     if (lut.unproject(u, v, ray)) ...       // unit vector: x right, y down, z forward; false: no light there
//     if (lut.project(point, pixel)) ...      // of a point in the camera's frame, any unit; false: not in the image
//
// Pixel (0, 0) is the centre of the upper left one. lut.max_error_px() says how far off the camera the table is at most.
// Both functions are const and may be called by many threads at once. Any file is read or refused, never trusted.
#ifndef RINGSOLID_LUT_H
#define RINGSOLID_LUT_H

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace ringsolid {

class Lut {
 public:
  int width() const { return static_cast<int>(side_[0]); }
  int height() const { return static_cast<int>(side_[1]); }
  double max_error_px() const { return max_error_px_; }
  double rms_error_px() const { return rms_error_px_; }

  bool read(const std::string& path, std::string& error) {
    std::ifstream file(path, std::ios::binary);
    if (!file) return fail(error, "cannot be opened");
    std::vector<unsigned char> bytes;
    char part[1 << 16];
    while (file.read(part, sizeof part), file.gcount() > 0) {
      bytes.insert(bytes.end(), part, part + file.gcount());
      if (bytes.size() > kLargest) return fail(error, "too large");
    }
    return parse(bytes.data(), bytes.size(), error);
  }

  bool parse(const unsigned char* data, std::size_t size, std::string& error) {
    control_.clear();
    seen_.clear();
    if (size < kHead || std::memcmp(data, "ringsolid lut 1\n", 16) != 0) return fail(error, "no table of rays, version 1");
    std::uint64_t number[4];
    for (int k = 0; k < 4; ++k) number[k] = whole(data + 16 + 4 * k, 4);
    for (int k = 0; k < 2; ++k) {
      if (number[k] < 1 || number[k] > 1000000 || number[2 + k] < 1 || number[2 + k] > 4096) return fail(error, "sizes");
    }
    const std::uint64_t controls = (number[2] + 3) * (number[3] + 3) * 2, spans = number[1] * 2;
    if (size != kHead + controls * 8 + spans * 4) return fail(error, "length");
    if (checksum(data, size) != whole(data + 48, 8)) return fail(error, "checksum");
    for (int k = 0; k < 2; ++k) side_[k] = number[k], cells_[k] = number[2 + k];
    max_error_px_ = real(data + 32);
    rms_error_px_ = real(data + 40);
    for (std::uint64_t k = 0; k < controls; ++k) {
      control_.push_back(real(data + kHead + 8 * k));
      if (!std::isfinite(control_.back())) return fail(error, "not finite");
    }
    for (std::uint64_t k = 0; k < spans; ++k) {
      seen_.push_back(static_cast<std::uint32_t>(whole(data + kHead + 8 * controls + 4 * k, 4)));
      if (seen_.back() > side_[0]) return fail(error, "light beyond the image");
    }
    for (int k = 0; k < 2; ++k) start_[k] = (static_cast<double>(side_[k]) - 1) / 2;
    evaluate(start_, middle_, slope_);
    return true;
  }

  // Whether light reaches a place of the image.
  bool sees(double u, double v) const {
    if (seen_.empty() || !(u >= -0.5 && u < side_[0] - 0.5 && v >= -0.5 && v < side_[1] - 0.5)) return false;
    const auto row = static_cast<std::size_t>(v + 0.5), column = static_cast<std::size_t>(u + 0.5);
    return column >= seen_[2 * row] && column < seen_[2 * row + 1];
  }

  bool unproject(double u, double v, double ray[3]) const {
    if (!sees(u, v)) return false;
    const double place[2] = {u, v};
    double plane[2];
    evaluate(place, plane, nullptr);
    const double square = plane[0] * plane[0] + plane[1] * plane[1];
    ray[0] = 2 * plane[0] / (1 + square);
    ray[1] = 2 * plane[1] / (1 + square);
    ray[2] = (1 - square) / (1 + square);
    return true;
  }

  bool project(const double point[3], double pixel[2]) const {
    const double away = std::hypot(point[0], point[1], point[2]) + point[2];
    if (seen_.empty() || !(away > 0)) return false;
    const double goal[2] = {point[0] / away, point[1] / away};
    double place[2] = {start_[0], start_[1]}, plane[2] = {middle_[0], middle_[1]};
    double slope[4] = {slope_[0], slope_[1], slope_[2], slope_[3]};
    for (int step = 0; step < 30; ++step) {  // Newton's method, kept near the image
      const double determinant = slope[0] * slope[3] - slope[1] * slope[2];
      const double off[2] = {goal[0] - plane[0], goal[1] - plane[1]};
      const double move[2] = {(slope[3] * off[0] - slope[1] * off[1]) / determinant,
                              (slope[0] * off[1] - slope[2] * off[0]) / determinant};
      double moved = 0;
      for (int k = 0; k < 2; ++k) {
        if (!std::isfinite(move[k])) return false;
        const double margin = static_cast<double>(side_[k]) / cells_[k];
        const double next = std::fmin(std::fmax(place[k] + move[k], -margin), side_[k] + margin);
        moved += std::fabs(next - place[k]);
        place[k] = next;
      }
      if (moved < 1e-7) {
        pixel[0] = place[0];
        pixel[1] = place[1];
        return std::fabs(move[0]) + std::fabs(move[1]) < 1e-6 && sees(place[0], place[1]);
      }
      evaluate(place, plane, slope);
    }
    return false;
  }

 private:
  static constexpr std::size_t kHead = 56, kLargest = std::size_t{1} << 29;
  std::uint64_t side_[2] = {0, 0}, cells_[2] = {0, 0};
  double max_error_px_ = 0, rms_error_px_ = 0;
  double start_[2] = {0, 0}, middle_[2] = {0, 0}, slope_[4] = {1, 0, 0, 1};
  std::vector<double> control_;
  std::vector<std::uint32_t> seen_;

  bool fail(std::string& error, const char* why) {
    control_.clear();
    seen_.clear();
    error = std::string("not a camera.lut that can be read: ") + why;
    return false;
  }

  static std::uint64_t whole(const unsigned char* byte, int count) {  // little endian on any machine
    std::uint64_t value = 0;
    for (int k = count - 1; k >= 0; --k) value = value << 8 | byte[k];
    return value;
  }

  static double real(const unsigned char* byte) {
    const std::uint64_t bits = whole(byte, 8);
    double value;
    std::memcpy(&value, &bits, sizeof value);
    return value;
  }

  static std::uint32_t checksum(const unsigned char* data, std::size_t size) {  // CRC-32 of all but itself
    std::uint32_t crc = 0xFFFFFFFFu;
    for (std::size_t k = 0; k < size; ++k) {
      if (k >= 48 && k < kHead) continue;
      crc ^= data[k];
      for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (0xEDB88320u & (0u - (crc & 1u)));
    }
    return ~crc;
  }

  // The surface at a place (u, v), and its slopes, if asked for: of the first part by u and v, then of the second.
  void evaluate(const double place[2], double plane[2], double* slope) const {
    double weight[2][4], change[2][4] = {{0, 0, 0, 0}, {0, 0, 0, 0}};
    std::size_t cell[2];
    for (int k = 0; k < 2; ++k) {
      const double per_px = static_cast<double>(cells_[k]) / side_[k], x = (place[k] + 0.5) * per_px;
      const double last = static_cast<double>(cells_[k] - 1);
      cell[k] = static_cast<std::size_t>(std::fmin(std::fmax(std::floor(x), 0.0), last));
      const double t = x - cell[k], s = 1 - t;
      weight[k][0] = s * s * s / 6;
      weight[k][1] = (3 * t * t * t - 6 * t * t + 4) / 6;
      weight[k][2] = (3 * s * s * s - 6 * s * s + 4) / 6;
      weight[k][3] = t * t * t / 6;
      if (slope == nullptr) continue;
      change[k][0] = -s * s / 2 * per_px;
      change[k][1] = (3 * t * t - 4 * t) / 2 * per_px;
      change[k][2] = -(3 * s * s - 4 * s) / 2 * per_px;
      change[k][3] = t * t / 2 * per_px;
    }
    double sum[6] = {0, 0, 0, 0, 0, 0};
    for (int j = 0; j < 4; ++j) {
      const double* row = control_.data() + 2 * ((cell[1] + j) * (cells_[0] + 3) + cell[0]);
      for (int part = 0; part < 2; ++part) {
        double value = 0, across = 0;
        for (int i = 0; i < 4; ++i) value += weight[0][i] * row[2 * i + part];
        sum[part] += weight[1][j] * value;
        if (slope == nullptr) continue;
        for (int i = 0; i < 4; ++i) across += change[0][i] * row[2 * i + part];
        sum[2 + 2 * part] += weight[1][j] * across;
        sum[3 + 2 * part] += change[1][j] * value;
      }
    }
    plane[0] = sum[0];
    plane[1] = sum[1];
    for (int k = 0; slope != nullptr && k < 4; ++k) slope[k] = sum[2 + k];
  }
};

}  // namespace ringsolid

#endif
/* ringsolid.reader-h */
