"""What a calibration starts from: photos, detections and correspondences, read with suspicion."""
