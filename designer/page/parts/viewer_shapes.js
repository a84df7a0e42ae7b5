/* The shapes of the page's 3D views: from the JSON of designer/page/scene.py to what THREE draws (three_entry.js says
   what of it there is). Names come from files and may hold anything: they become letters on a canvas only. */
"use strict";

const ringsolidShapes = (() => {
  // ---- from JSON to arrays

  const ARRAYS = { f4: Float32Array, u2: Uint16Array, u4: Uint32Array };

  /** The numbers of a packed array; every machine that browsers run on is little-endian, as the data is. */
  function unpack(packed) {
    const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
    return new ARRAYS[packed.type](bytes.buffer);
  }

  /** One THREE.Color for each thing. */
  function unpackColours(colours) {
    const palette = colours.palette.map((text) => new THREE.Color(text));
    return Array.from(unpack(colours.index), (row) => palette[row]);
  }

  function vectors(numbers) {
    const list = [];
    for (let n = 0; n < numbers.length; n += 3) list.push(new THREE.Vector3().fromArray(numbers, n));
    return list;
  }

  // ---- shapes. Each builder gives the object to draw, the points to fit into the view, and what can be pointed at.

  function buildSurface(shape) {
    const geometry = new THREE.BufferGeometry();
    const vertices = unpack(shape.vertices_mm);
    geometry.setAttribute("position", new THREE.BufferAttribute(vertices, 3));
    geometry.setIndex(new THREE.BufferAttribute(unpack(shape.triangles), 1));
    const material = new THREE.MeshLambertMaterial({
      color: shape.colour,
      side: THREE.DoubleSide,
      flatShading: true,
      polygonOffset: true, // pushed back a little: what lies on it is drawn whole
      polygonOffsetFactor: 1,
      polygonOffsetUnits: 2,
    });
    const mesh = new THREE.Mesh(geometry, material);
    return { object: mesh, points: vectors(vertices), blocks: mesh };
  }

  /** Rings of like proportions share one geometry; to a two-hundredth of the radius, nobody sees the difference. */
  function buildRings(shape) {
    const center = vectors(unpack(shape.center_mm));
    const normal = vectors(unpack(shape.normal));
    const outer = unpack(shape.radius_outer_mm);
    const inner = unpack(shape.radius_inner_mm);
    const colours = unpackColours(shape.colours);
    const groups = new Map();
    outer.forEach((radius, ring) => {
      const share = Math.round((200 * inner[ring]) / radius);
      if (!groups.has(share)) groups.set(share, []);
      groups.get(share).push(ring);
    });
    const object = new THREE.Group();
    const front = new THREE.Vector3(0, 0, 1);
    // Colours that stand for values must look as in the legend, so no light falls on them.
    const Material = shape.colours.palette.length > 1 ? THREE.MeshBasicMaterial : THREE.MeshLambertMaterial;
    for (const [share, rings] of groups) {
      const geometry = new THREE.RingGeometry(Math.min(share / 200, 0.995), 1, 64, 1);
      const mesh = new THREE.InstancedMesh(geometry, new Material({ side: THREE.DoubleSide }), rings.length);
      rings.forEach((ring, row) => {
        const turn = new THREE.Quaternion().setFromUnitVectors(front, normal[ring].normalize());
        const lifted = center[ring].clone().addScaledVector(normal[ring], 0.002 * outer[ring]);
        const scale = new THREE.Vector3(outer[ring], outer[ring], 1);
        mesh.setMatrixAt(row, new THREE.Matrix4().compose(lifted, turn, scale));
        mesh.setColorAt(row, colours[ring]);
      });
      mesh.frustumCulled = false;
      object.add(mesh);
    }
    const pick = shape.names.length ? (ray) => pickRing(ray, center, normal, outer, shape.names) : null;
    return { object, points: center, normals: normal, pick };
  }

  /** The nearest ring on the ray that is seen from its front, its white centre included. */
  function pickRing(ray, center, normal, outer, names) {
    let best = null;
    const to = new THREE.Vector3();
    for (let ring = 0; ring < center.length; ring += 1) {
      const towards = ray.direction.dot(normal[ring]);
      if (towards >= 0) continue;
      const distance = to.copy(center[ring]).sub(ray.origin).dot(normal[ring]) / towards;
      const isHit = distance > 0 && to.copy(ray.origin).addScaledVector(ray.direction, distance)
        .distanceTo(center[ring]) <= outer[ring];
      if (isHit && (!best || distance < best.distance)) {
        best = { distance, name: names[ring], outline: () => circle(center[ring], normal[ring], 1.12 * outer[ring]) };
      }
    }
    return best;
  }

  /** A circle as pairs of ends. */
  function circle(center, normal, radius) {
    const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), normal);
    const at = (n) => new THREE.Vector3(Math.cos((n * Math.PI) / 24), Math.sin((n * Math.PI) / 24), 0)
      .multiplyScalar(radius).applyQuaternion(turn).add(center);
    return Array.from({ length: 48 }, (_, n) => [at(n), at(n + 1)]).flat();
  }

  function lines(ends, colours, width) {
    const geometry = new THREE.LineSegmentsGeometry();
    geometry.setPositions(ends.flatMap((end) => end.toArray()));
    if (colours) geometry.setColors(colours.flatMap((colour) => [...colour.toArray(), ...colour.toArray()]));
    const material = new THREE.LineMaterial({ linewidth: width, vertexColors: Boolean(colours) });
    const object = new THREE.LineSegments2(geometry, material);
    object.frustumCulled = false;
    return object;
  }

  function buildSegments(shape) {
    const ends = vectors(unpack(shape.ends_mm));
    if (!ends.length) return { object: new THREE.Group(), points: [] };
    return { object: lines(ends, unpackColours(shape.colours), 1.6), points: ends };
  }

  /** Pyramids and domes with a filled tick on the side that is up in the photo; faint walls make them easy to point at. */
  function buildCameras(shape) {
    const poses = unpack(shape.target_from_cam);
    const [rows, spokes] = shape.view.shape;
    const view = vectors(unpack(shape.view)).map((point) => point.multiplyScalar(shape.size_mm));
    const at = (row, spoke) => 1 + row * spokes + (spoke % spokes); // 0 is the apex
    const border = Array.from({ length: spokes }, (_, spoke) => [at(rows - 1, spoke), at(rows - 1, spoke + 1)]);
    const ribs = [0, 1, 2, 3].map((quarter) => (quarter * spokes) / 4);
    const corners = ribs.map((spoke) => view[at(rows - 1, spoke) - 1]);
    const width = corners[0].distanceTo(corners[1]);
    const middle = corners[0].clone().add(corners[1]).multiplyScalar(0.5);
    const upwards = middle.clone().sub(corners[3].clone().add(corners[2]).multiplyScalar(0.5)).normalize();
    const along = corners[1].clone().sub(corners[0]).normalize();
    const tick = [-0.18, 0.18].map((share) => middle.clone().addScaledVector(along, share * width))
      .concat(middle.clone().addScaledVector(upwards, 0.24 * width));
    const local = [new THREE.Vector3(), ...view, ...tick.map((p) => p.addScaledVector(upwards, 0.06 * width))];
    const edges = [...ribs.flatMap((spoke) => [0, at(rows - 1, spoke)]), ...border.flat()];
    const walls = border.flatMap((side) => [0, ...side]);
    for (let row = 1; row < rows; row++) {
      edges.push(...ribs.flatMap((spoke) => [at(row - 1, spoke), at(row, spoke)]));
      for (let spoke = 0; spoke < spokes; spoke++) {
        const [a, b, c, d] = [at(row - 1, spoke), at(row - 1, spoke + 1), at(row, spoke), at(row, spoke + 1)];
        walls.push(a, b, c, b, d, c);
      }
    }
    for (let spoke = 1; spoke < spokes - 1; spoke++) walls.push(1, at(0, spoke), at(0, spoke + 1));
    const cameras = shape.names.map((name, row) => {
      const pose = new THREE.Matrix4().fromArray(poses, 16 * row).transpose(); // three.js holds columns
      return local.map((point) => point.clone().applyMatrix4(pose));
    });
    const colours = unpackColours(shape.colours);
    const ends = (camera) => edges.map((corner) => camera[corner]);
    const object = new THREE.Group();
    if (!cameras.length) return { object, points: [] };
    const eachEdge = colours.flatMap((colour) => Array(edges.length / 2).fill(colour));
    const wall = triangles(cameras, walls, colours, { transparent: true, opacity: 0.1, depthWrite: false });
    object.add(lines(cameras.flatMap(ends), eachEdge, 1.4), wall, triangles(cameras, [0, 1, 2].map((k) => 1 + view.length + k), colours, {}));
    const pick = (ray, caster) => {
      const hit = caster.intersectObject(wall, false)[0];
      if (!hit) return null;
      const row = Math.floor(hit.faceIndex / (walls.length / 3));
      return { distance: hit.distance, name: shape.names[row], outline: () => ends(cameras[row]) };
    };
    return { object, points: cameras.flatMap((camera) => camera.slice(0, 1 + view.length)), pick, isFar: true };
  }

  /** The same triangles of several cameras, unlit. */
  function triangles(cameras, corners, colours, look) {
    const points = cameras.flatMap((camera) => corners.flatMap((corner) => camera[corner].toArray()));
    const shades = colours.flatMap((colour) => corners.flatMap(() => colour.toArray()));
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(shades), 3));
    const material = new THREE.MeshBasicMaterial({ side: THREE.DoubleSide, vertexColors: true, ...look });
    return new THREE.Mesh(geometry, material);
  }

  function buildLabels(shape) {
    const position = vectors(unpack(shape.position_mm));
    const normal = vectors(unpack(shape.normal));
    const object = new THREE.Group();
    position.forEach((point, row) => object.add(label(shape.texts[row], point, normal[row], shape.size_mm)));
    const points = position.map((point, row) => point.clone().addScaledVector(normal[row], 0.75 * shape.size_mm));
    return { object, points, labels: object.children };
  }

  /** White letters on a dark plate, which read on any body colour; `size` is the height of a capital. */
  function label(text, position, normal, size) {
    const letter = 72;
    const canvas = document.createElement("canvas");
    const pen = canvas.getContext("2d");
    const font = `600 ${letter}px system-ui, sans-serif`;
    const shown = text.length > 40 ? `${text.slice(0, 39)}\u2026` : text;
    pen.font = font;
    const wide = Math.ceil(pen.measureText(shown).width) + letter;
    canvas.height = 1.5 * letter;
    canvas.width = Math.max(canvas.height, wide);
    pen.font = font; // a canvas forgets it when its size changes
    pen.fillStyle = "rgba(22, 27, 34, 0.86)";
    pen.beginPath();
    pen.roundRect(0, 0, canvas.width, canvas.height, canvas.height / 2);
    pen.fill();
    pen.fillStyle = "#ffffff";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.fillText(shown, canvas.width / 2, 0.53 * canvas.height);
    const map = new THREE.CanvasTexture(canvas);
    map.colorSpace = THREE.SRGBColorSpace;
    const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false, depthWrite: false }));
    const scale = size / (0.72 * letter);
    sprite.scale.set(canvas.width * scale, canvas.height * scale, 1);
    sprite.position.copy(position);
    sprite.renderOrder = 2;
    sprite.userData.normal = normal;
    return sprite;
  }

  const BUILDERS = {
    surface: buildSurface, rings: buildRings, segments: buildSegments, cameras: buildCameras, labels: buildLabels,
  };

  function buildLayer(layer) {
    const parts = layer.shapes.map((shape) => BUILDERS[shape.kind](shape));
    const group = new THREE.Group();
    parts.forEach((part) => group.add(part.object));
    group.visible = layer.shown;
    return { name: layer.name, hasSwitch: layer.switch, group, parts };
  }

  return { buildLayer, lines };
})();
