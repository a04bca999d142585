"""Light in OpenGL: Phong's model with shadows, which replaces VTK's own shader code.

VTK multiplies textures with all light, including highlights; here highlights are white on every texture.
"""

from typing import Any

import numpy as np

from ..kernels.pictures import shading, shadow
from ..world import Reflectance
from .light import CONTACT, GOLDEN, SHADED, SHADOW, SOFTNESS, TONE, Lights, spread
from .shadow_map import SIZE, ShadowMap
from .stage import Ground

TAPS = 4
"""Texels of the shadow map sampled for a fragment; 4 x 4 neighbouring fragments sample different ones."""


def _of_fragments(numbers: np.ndarray) -> str:
    """Return four vectors, shape [4, n], as arguments of the shader's `oneOf`: one for each of 2 x 2 pixels."""
    # A choice between constants, because on CPUs an array look-up would dominate the cost.
    return ", ".join(f"vec{numbers.shape[1]}({', '.join(f'{x:.6f}' for x in row)})" for row in numbers)


_POINTS = spread(4 * TAPS).reshape(4, TAPS, 2)
_RINGS = np.linalg.norm(_POINTS, axis=-1)
_START = np.pad(_POINTS[:, 0] / _RINGS[:, :1], ((0, 0), (0, 2)))
# Four fragments are a pixel of a picture; those beside it sample points that are turned.
_TURN = 4 * TAPS * GOLDEN * np.arange(4)
_TURNS = np.stack([np.cos(_TURN), np.sin(_TURN), -np.sin(_TURN), np.cos(_TURN)], axis=1)
_COS, _SIN = np.cos(GOLDEN), np.sin(GOLDEN)

_DECLARED = f"""
in vec4 lampVSOutput;
vec4 oneOf(ivec2 fragment, vec4 a, vec4 b, vec4 c, vec4 d)
{{
  return fragment.y == 0 ? (fragment.x == 0 ? a : b) : (fragment.x == 0 ? c : d);
}}
// Whether the light passes the texel that lies aside by so many metres, where the surface goes on as a plane.
float clearAt(vec3 at, vec2 slope, float margin, vec2 aside)
{{
  vec2 place = (at.xy + aside) / lampUnits.y;
  ivec2 one = clamp(ivec2(place), 0, {SIZE - 1});
  // Four texels in a row are one color.
  vec4 four = texelFetch(shadowMap, ivec2(one.x >> 2, one.y), 0);
  vec2 two = (one.x & 2) == 0 ? four.xy : four.zw;
  float nearest = (one.x & 1) == 0 ? two.x : two.y;
  return nearest > at.z + dot(slope, aside) + margin ? 0.0 : {1 / TAPS};
}}
// The fraction of the key light that is seen from a surface that faces it, and 0 from others.
float keyLight(vec3 at, float facing)
{{
  vec3 normal = cross(dFdx(at), dFdy(at));
  vec2 inMap = abs(at.xy * lampUnits.x - 0.5);
  float above = texture(shadowAround, at.xy * lampUnits.x).r - at.z;
  vec2 slope = -normal.xy / (abs(normal.z) < 1e-20 ? 1e-20 : normal.z);
  slope *= min(1.0, {shadow.STEEPEST} / max(length(slope), 1e-6));
  // A texel holds the distance at its middle, half a texel aside.
  float margin = lampUnits.y * (0.3 + 0.6 * (abs(slope.x) + abs(slope.y)));
  bool inLight = lampUnits.z == 0.0 || above <= margin || max(inMap.x, inMap.y) > 0.5;
  float radius = clamp({SOFTNESS} * above, {shadow.LEAST} * lampUnits.y, {shadow.MOST} * lampUnits.y);
  ivec2 fragment = ivec2(gl_FragCoord.xy) & 1;
  vec4 turn = oneOf((ivec2(gl_FragCoord.xy) >> 1) & 1, {_of_fragments(_TURNS)});
  vec2 aside = mat2(turn.xy, turn.zw) * oneOf(fragment, {_of_fragments(_START)}).xy;
  vec4 rings = oneOf(fragment, {_of_fragments(_RINGS)});
  float lit = inLight ? 1.0 : 0.0;
  // Processors skip loops, while they go both ways at an if.
  int taps = inLight || facing <= 0.0 ? 0 : {TAPS};
  for (int k = 0; k < taps; ++k)
  {{
    lit += clearAt(at, slope, margin, radius * rings.x * aside);
    rings = rings.yzwx;
    aside = mat2({_COS:.7f}, {_SIN:.7f}, {-_SIN:.7f}, {_COS:.7f}) * aside;
  }}
  return lit;
}}
"""

_ON_BODIES = f"""
  vec3 towardsEye = normalize(-vertexVC.xyz);
  float keyFacing = dot(normalVCVSOutput, -lightDirectionVC0);
  float headFacing = dot(normalVCVSOutput, -lightDirectionVC1);
  float lit = keyLight(lampVSOutput.xyz, keyFacing);
  float key = lightColor0.r * max(keyFacing, 0.0) * mix({SHADED}, 1.0, lit);
  float head = lightColor1.r * max(headFacing, 0.0);
  float fill = lightColor2.r * max(dot(normalVCVSOutput, -lightDirectionVC2), 0.0);
  float above = max(lampVSOutput.w, 0.0);
  float down = 0.5 - 0.5 * dot(normalVCVSOutput, upVSOutput);
  float around = mix(fromAround.x, fromAround.y * above / (above + 1.0), down);
  float light = min(around + key + head + fill, 1.0);
  light += {TONE} * light * (1.0 - light);
  gl_FragData[0] = vec4(light * diffuseColor, opacity);
  float glint = 0.0;
  if (specularColor.r > 0.0)
  {{
    vec3 mirrored = reflect(-towardsEye, normalVCVSOutput);
    if (keyFacing > 0.0)
      glint += lit * lightColor0.r * pow(max(dot(mirrored, -lightDirectionVC0), 1e-5), specularPower);
    if (headFacing > 0.0)
      glint += lightColor1.r * pow(max(dot(mirrored, -lightDirectionVC1), 1e-5), specularPower);
    glint *= specularColor.r;
  }}
"""
_MIRRORED = f"""
  float along = min(dot(normalVCVSOutput, towardsEye), 1.0);
  float edge = 1.0 - max(along, 0.0);
  float upwards = dot(reflect(-towardsEye, normalVCVSOutput), upVSOutput);
  float sky = smoothstep({shading.DARK_BELOW}, {shading.BRIGHT_ABOVE}, upwards);
  float mirroredSky = {shading.MIRRORED_SKY} - {shading.ZENITH} * max(upwards, 0.0);
  float mirrored = mix({shading.MIRRORED_GROUND}, mirroredSky, sky);
"""
_GLINT = """
  gl_FragData[0].rgb += vec3(glint);
"""
_ON_GROUND = f"""
  gl_FragData[0] = vec4(vec3(mix({SHADOW}, 1.0, keyLight(lampVSOutput.xyz, 1.0))), 1.0);
"""
DEPTH_ALONE = """
  gl_FragData[0] = vec4(0.0);
  float glint = 0.0;
"""
"""Code that draws nothing, but hides what is behind."""


def of_finish(reflectance: Reflectance) -> str:
    """Return the code that lights a body of a finish, as `light_on` in `kernels/pictures/shading.py` does."""
    _, metallic, sheen, opacity = reflectance
    code = _ON_BODIES
    if sheen or metallic or opacity < 1:
        code += _MIRRORED
    if sheen:
        code += f"  gl_FragData[0].rgb += {sheen} * edge * edge * diffuseColor;\n"
    if metallic:
        code += f"""
  gl_FragData[0].rgb += {metallic} * (mirrored * diffuseColor - gl_FragData[0].rgb) + glint * diffuseColor;
  glint = 0.0;
"""
    elif opacity < 1:
        code += f"""
  float mirrors = mix({shading.MIRRORS}, 1.0, pow(edge, 5.0));
  float held = 1.0 - {1 - opacity} * (1.0 - mirrors) * (1.0 - min(glint, 1.0));
  gl_FragData[0] = vec4({opacity} / held * gl_FragData[0].rgb, held);
  glint = (glint + mirrors * mirrored) / held;
"""
    return code


class Shading:
    """The light of a drawing, with shadows of the key light, for OpenGL's actors; `even` as for `light.lights`."""

    def __init__(
        self, pv: Any, shadow_map: ShadowMap, lights: Lights, ground: Ground | None, *, even: bool
    ) -> None:
        self._map, self._around = shadow_map, lights[:2]
        self._height = np.array([0.0, 0.0, 0.0, 1e9])
        """Height above the ground over that where half of its light arrives: coefficients of x, y, z and 1."""
        if ground is not None and not even:
            self._height = np.append(ground.normal, -ground.centre @ ground.normal) / (CONTACT * ground.reach)
        self._matrix = pv.vtkmatrix_from_array(np.eye(4))
        self._textures = {
            "shadowMap": _of_numbers(pv, shadow_map.depth.reshape(SIZE, SIZE // 4, 4), between=False),
            "shadowAround": _of_numbers(pv, shadow_map.around, between=True),
        }
        self._programs: list[tuple[Any, bool]] = []

    def light(self, actor: Any, code: str | None = None, *, shadows: bool = True) -> None:
        """Light an actor by the code of its finish; None for the ground, which is unlit and only shows shadows."""
        program = actor.GetShaderProperty()
        for name, (_, texture) in self._textures.items():
            actor.prop.SetTexture(name, texture)
        program.GetVertexCustomUniforms().SetUniformMatrix("toLamp", self._matrix)
        program.GetFragmentCustomUniforms().SetUniform3f("lampUnits", (1.0, 1.0, 0.0))
        program.GetFragmentCustomUniforms().SetUniform2f("fromAround", self._around)
        vertex, fragment = program.AddVertexShaderReplacement, program.AddFragmentShaderReplacement

        def add(to: Any, tag: str, code: str) -> None:
            to(tag, True, f"{tag}\n{code}\n", False)

        add(vertex, "//VTK::PositionVC::Dec", "out vec4 lampVSOutput;")
        add(vertex, "//VTK::PositionVC::Impl", "  lampVSOutput = toLamp * vertexMC;")
        # After the textures' own declarations, which are used here.
        add(fragment, "//VTK::TCoord::Dec", _DECLARED)
        fragment("//VTK::Light::Impl", True, _ON_GROUND if code is None else code, False)
        if code is not None:
            add(fragment, "//VTK::TCoord::Impl", _GLINT)
            # The upward direction in camera coordinates.
            add(vertex, "//VTK::Normal::Dec", "out vec3 upVSOutput;")
            add(vertex, "//VTK::Normal::Impl", "  upVSOutput = normalMatrix[2];")
            add(fragment, "//VTK::Normal::Dec", "in vec3 upVSOutput;")
        self._programs.append((program, shadows))

    def follow(self, *, shadows: bool = True) -> None:
        """Update from the shadow map; without `shadows` the key light reaches everything."""
        matrix = np.vstack([self._map.to_lamp()[:3], self._height])
        self._matrix.DeepCopy(matrix.T.ravel().tolist())  # OpenGL reads column by column
        for program, takes_shadows in self._programs:
            program.GetVertexCustomUniforms().SetUniformMatrix("toLamp", self._matrix)
            units = (1 / self._map.width, self._map.texel, float(shadows and takes_shadows))
            program.GetFragmentCustomUniforms().SetUniform3f("lampUnits", units)
        for image, texture in self._textures.values():
            image.GetPointData().GetScalars().Modified()
            image.Modified()
            texture.Modified()


def _of_numbers(pv: Any, numbers: np.ndarray, *, between: bool) -> tuple[Any, Any]:
    """Return an image that shares the memory of numbers, shape [rows, columns, 4], and a texture of it.

    VTK rounds textures with fewer than four channels. `between` texels may be interpolated.
    """
    rows, columns, _ = numbers.shape
    image = pv.ImageData(dimensions=(columns, rows, 1))
    image.point_data["numbers"] = numbers.reshape(-1, 4)
    image.GetPointData().SetActiveScalars("numbers")
    texture = pv.Texture()
    texture.SetInputData(image)
    texture.SetColorModeToDirectScalars()
    texture.SetInterpolate(between)
    texture.MipmapOff()
    texture.SetRepeat(False)
    return image, texture
