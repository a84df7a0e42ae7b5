"""A target for simulators: one mesh with a picture, and the files that put it into a world with mass and inertia.

`NAME.sim.obj` (with `.mtl` and `.png`) and `NAME.sim.glb` are the mesh; `NAME.urdf` (ROS, PyBullet), `NAME.sdf`
(Gazebo), `NAME.mjcf.xml` (MuJoCo) and `NAME.usda` (Isaac Sim, Blender) name it. The body's frame is the target's, so
that a pose in the simulator is the pose that `calib` solves for.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np

from designer.base.arrays import Array
from designer.formats.glb import ROUGHNESS, textured_glb
from designer.make.textured import TexturedMesh

M_PER_MM = 0.001
File = tuple[str, bytes, str]
"""Suffix, content, purpose."""


@dataclass(frozen=True, eq=False)
class Weight:
    """Of a rigid body, in the target's frame."""

    mass_kg: float
    centre_m: Array  # (3,)
    inertia_kg_m2: Array  # (3, 3) about the centre of mass


def weight_of(mesh: TexturedMesh, mass_kg: float) -> Weight:
    """A body of one density that is as heavy, by the tetrahedra between its triangles and the origin."""
    corner = M_PER_MM * mesh.corner_mm[mesh.triangles]  # (T, 3, 3)
    volume = np.linalg.det(corner) / 6
    total = corner.sum(axis=1)
    centre: Array = (volume[:, None] * total).sum(axis=0) / (4 * volume.sum())
    outer = np.einsum("ti,tj->tij", total, total) + np.einsum("tki,tkj->tij", corner, corner)
    second = (volume[:, None, None] * outer).sum(axis=0) / (20 * volume.sum()) - np.outer(centre, centre)
    inertia = mass_kg * (np.trace(second) * np.eye(3) - second)
    return Weight(mass_kg, _without_rounding(centre), _without_rounding(inertia))


def _without_rounding(values: Array) -> Array:
    """Zeros where a symmetric body leaves only rounding."""
    return np.where(np.abs(values) < 1e-12, 0.0, values)


def simulator_files(name: str, mesh: TexturedMesh, weight: Weight) -> Iterator[File]:
    """All files, which name each other as `NAME.sim.*` beside them.

    Args:
        name: of the design.
        mesh: the target.
        weight: of it.
    """
    yield "sim.png", mesh.picture, "the artwork, for the meshes beside it"
    material = f"newmtl artwork\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nNs 1\nillum 1\nmap_Kd {name}.sim.png\n"
    yield "sim.mtl", material.encode(), "the material of the mesh"
    yield "sim.obj", _obj(name, mesh).encode(), "a textured mesh in mm, for simulators, Blender and colour printing"
    yield "sim.glb", textured_glb(mesh), "the same in one file, in metres"
    yield "urdf", _urdf(name, weight).encode(), "for ROS and PyBullet"
    yield "sdf", _sdf(name, weight).encode(), "for Gazebo"
    yield "mjcf.xml", _mjcf(name, weight).encode(), "for MuJoCo"
    yield "usda", _usda(name, mesh, weight).encode(), "for Isaac Sim, Omniverse and Blender"


def _numbers(values: Array, digits: int = 9) -> str:
    return " ".join(f"{value:.{digits}g}" for value in np.asarray(values).ravel().tolist())


def _obj(name: str, mesh: TexturedMesh) -> str:
    lines = ["# millimetres, in the target's frame", f"mtllib {name}.sim.mtl", "o target", "usemtl artwork", "s off"]
    lines += [f"v {_numbers(one)}" for one in mesh.corner_mm]
    lines += [f"vt {_numbers(one)}" for one in mesh.place]
    lines += [f"vn {_numbers(one)}" for one in mesh.normal]
    lines += ["f " + " ".join(f"{k}/{k}/{k}" for k in (one + 1).tolist()) for one in mesh.triangles]
    return "\n".join(lines) + "\n"


def _inertia(weight: Weight) -> dict[str, str]:
    matrix = weight.inertia_kg_m2
    place = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
    return {f"i{axes}": f"{matrix[at]:.9g}" for axes, at in place.items()}


def _urdf(name: str, weight: Weight) -> str:
    inertia = " ".join(f'{axes}="{value}"' for axes, value in _inertia(weight).items())
    mesh = f'<mesh filename={quoteattr(f"{name}.sim.obj")} scale="0.001 0.001 0.001"/>'
    return f"""<?xml version="1.0"?>
<robot name={quoteattr(name)}>
  <link name="target">
    <inertial>
      <origin xyz="{_numbers(weight.centre_m)}" rpy="0 0 0"/>
      <mass value="{weight.mass_kg:.9g}"/>
      <inertia {inertia}/>
    </inertial>
    <visual><geometry>{mesh}</geometry></visual>
    <collision><geometry>{mesh}</geometry></collision>
  </link>
</robot>
"""


def _sdf(name: str, weight: Weight) -> str:
    inertia = "".join(f"<{axes}>{value}</{axes}>" for axes, value in _inertia(weight).items())
    uri = f"<mesh><uri>{name}.sim.obj</uri><scale>0.001 0.001 0.001</scale></mesh>"
    return f"""<?xml version="1.0"?>
<sdf version="1.9">
  <model name={quoteattr(name)}>
    <link name="target">
      <inertial>
        <pose>{_numbers(weight.centre_m)} 0 0 0</pose>
        <mass>{weight.mass_kg:.9g}</mass>
        <inertia>{inertia}</inertia>
      </inertial>
      <visual name="artwork"><geometry>{uri}</geometry></visual>
      <collision name="surface"><geometry>{uri}</geometry></collision>
    </link>
  </model>
</sdf>
"""


def _mjcf(name: str, weight: Weight) -> str:
    """MuJoCo's order of the inertia is xx yy zz xy xz yz."""
    given = _inertia(weight)
    full = " ".join(given[f"i{axes}"] for axes in ("xx", "yy", "zz", "xy", "xz", "yz"))
    return f"""<mujoco model={quoteattr(name)}>
  <asset>
    <texture name="artwork" type="2d" file={quoteattr(f"{name}.sim.png")}/>
    <material name="artwork" texture="artwork" specular="0" shininess="0"/>
    <mesh name="target" file={quoteattr(f"{name}.sim.obj")} scale="0.001 0.001 0.001"/>
  </asset>
  <worldbody>
    <body name="target">
      <freejoint/>
      <inertial pos="{_numbers(weight.centre_m)}" mass="{weight.mass_kg:.9g}" fullinertia="{full}"/>
      <geom type="mesh" mesh="target" material="artwork"/>
    </body>
  </worldbody>
</mujoco>
"""


def _usda(name: str, mesh: TexturedMesh, weight: Weight) -> str:
    """Units of millimetres and kilograms; the inertia as principal moments and the axes they are about."""
    from scipy.spatial.transform import Rotation

    moments, axes = np.linalg.eigh(weight.inertia_kg_m2 / M_PER_MM**2)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    turn = Rotation.from_matrix(axes).as_quat(scalar_first=True)

    def tuples(values: Array) -> str:
        return ", ".join(f"({', '.join(f'{value:.9g}' for value in one)})" for one in values.tolist())

    points, normals, places = tuples(mesh.corner_mm), tuples(mesh.normal), tuples(mesh.place)
    low, high = mesh.corner_mm.min(axis=0), mesh.corner_mm.max(axis=0)
    return f"""#usda 1.0
(
    defaultPrim = "target"
    kilogramsPerUnit = 1
    metersPerUnit = {M_PER_MM}
    upAxis = "Z"
)

def Xform "target" (
    prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
)
{{
    float physics:mass = {weight.mass_kg:.9g}
    point3f physics:centerOfMass = {tuples(weight.centre_m[None] / M_PER_MM)}
    float3 physics:diagonalInertia = {tuples(moments[None])}
    quatf physics:principalAxes = {tuples(turn[None])}

    def Mesh "surface" (
        prepend apiSchemas = ["MaterialBindingAPI", "PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]
    )
    {{
        uniform token physics:approximation = "convexHull"
        uniform token subdivisionScheme = "none"
        float3[] extent = [{tuples(np.stack([low, high]))}]
        int[] faceVertexCounts = [{", ".join(["3"] * len(mesh.triangles))}]
        int[] faceVertexIndices = [{", ".join(map(str, mesh.triangles.ravel().tolist()))}]
        point3f[] points = [{points}]
        normal3f[] normals = [{normals}] (
            interpolation = "vertex"
        )
        texCoord2f[] primvars:st = [{places}] (
            interpolation = "vertex"
        )
        rel material:binding = </target/artwork>
    }}

    def Material "artwork"
    {{
        token outputs:surface.connect = </target/artwork/surface.outputs:surface>

        def Shader "surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </target/artwork/picture.outputs:rgb>
            float inputs:metallic = 0
            float inputs:roughness = {ROUGHNESS}
            token outputs:surface
        }}

        def Shader "picture"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @./{name}.sim.png@
            token inputs:sourceColorSpace = "sRGB"
            float2 inputs:st.connect = </target/artwork/place.outputs:result>
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float3 outputs:rgb
        }}

        def Shader "place"
        {{
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }}
    }}
}}
"""
