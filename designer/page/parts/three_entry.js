/**
 * What the page's 3D viewer takes from three.js. `three.min.js` beside this file is made from it.
 *
 * To make it again, copy this file into an empty folder and run there:
 *
 *   npm install three@0.187.0 esbuild@0.28.2
 *   npx esbuild three_entry.js --bundle --minify --format=iife --global-name=THREE --target=es2020 \
 *     --charset=ascii --legal-comments=none --outfile=three.min.js \
 *     --banner:js="$(printf '/*!\nthree.js 0.187.0, reduced to what three_entry.js names.\n\n'; cat node_modules/three/LICENSE; printf '*''/')"
 */
export {
  BufferAttribute,
  BufferGeometry,
  CanvasTexture,
  Color,
  DirectionalLight,
  DoubleSide,
  Group,
  HemisphereLight,
  InstancedMesh,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  PerspectiveCamera,
  Quaternion,
  Raycaster,
  RingGeometry,
  SRGBColorSpace,
  Scene,
  Sprite,
  SpriteMaterial,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
export { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
export { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
export { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";
