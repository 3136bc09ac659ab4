/**
 * The one shader that draws base and segments, in every view mode (GLSL ES 3.00; three.js puts its own lines before).
 *
 * What a three.js scene does to its own materials it does by pieces of shader, included here by their names: fog, clipping
 * planes, lights, shadows, tone mapping. Each is compiled where it is used alone (ground-shading.ts).
 */

import { RAMP_STOPS } from "./palette.ts";

/** The shader's numbers of the view modes. */
export const MODE_NUMBER = {
  colour: 0,
  "vertex-colour": 1,
  regions: 2,
  segments: 3,
  attribute: 4,
  slope: 5,
  names: 6,
} as const;

/** Most ranges of a page of segments: their traits are 192 of the 256 vectors that WebGL 2 promises a vertex shader. */
export const MAX_RANGES = 64;
/** Vectors of four of a range: translation and step; scales of image and measure; colour of its segment, and layer and freshness. */
export const TRAIT_VECTORS = 3;

/** How much of the shape's light is laid over the survey's own colours. */
export const TINT_RELIEF = 0.35;

/** Whether three.js's lights are worked out at all. */
const IS_SHADED = /* glsl */ `
#if defined(LIT) || (defined(SHADOWED) && defined(USE_SHADOWMAP))
#define SHADED
#endif
`;

/**
 * Three.js's lights on matt ground, as on a MeshLambertMaterial: light for a colour of 1. The normal is not turned over for back
 * faces, as nowhere here. LIGHT is what a colour is multiplied by, with the shape's own light laid on as strongly as is said.
 *
 * Colours that are not LIT have their light in them, so a shadow takes of it the share that it takes of three.js's lights there:
 * nothing where no light came from, and never what the sky gives.
 */
const LIGHT = /* glsl */ `
#ifdef SHADED
#include <common>
// Depths of shadow maps, before three.js 0.182.
#include <packing>
#define RE_Direct(light, place, normal, view, coat, material, sum) sum.directDiffuse += saturate(dot(normal, light.direction)) * light.color
#define RE_IndirectDiffuse(light, place, normal, view, coat, material, sum) sum.indirectDiffuse += light
#include <lights_pars_begin>
#include <shadowmap_pars_fragment>
in vec3 vViewPosition;
in vec3 vViewTilt;

const float UNLIT = 0.0001;

vec3 lightOn(bool receiveShadow) {
  vec3 normal = normalize(vViewTilt);
  ReflectedLight reflectedLight = ReflectedLight(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0));
#include <lights_fragment_begin>
#include <lights_fragment_end>
  return RECIPROCAL_PI * (reflectedLight.directDiffuse + reflectedLight.indirectDiffuse);
}
#endif
#ifdef LIT
#define LIGHT(strength) sun
#elif defined(SHADED)
#define LIGHT(strength) (mix(1.0, light, strength) * sun)
#else
#define LIGHT(strength) mix(1.0, light, strength)
#endif
`;

/**
 * A vertex's place comes first, by one expression for everything: `translation + stepM * code` is exact in float32, and so is
 * its difference to the coarse part of the eye, a multiple of the grid's step as well. So equal vertices of two segments
 * get equal pixels, and four kilometres from the origin a head's movement is not rounded to half a millimetre. The eye is in
 * the ground's own frame; what moves, turns or scales the ground comes with the view's matrix, whose translation is not used.
 *
 * The base is pushed back along the line of sight (docs/topics/hand-off.md): a point stays on its pixel. What would be
 * pushed beyond the far plane is drawn just before it, and so still before the sky.
 */
export const VERTEX_SHADER = /* glsl */ `
in vec4 code;
in vec4 tilt;
in vec4 tint;
in vec2 spot;
in vec2 region;
in vec2 measure;

#ifdef PAGED
#ifndef GL_ANGLE_multi_draw
// Then three.js draws range by range, and says which here.
#define gl_DrawID _gl_DrawID
uniform int _gl_DrawID;
#endif
uniform vec4 traits[${MAX_RANGES * TRAIT_VECTORS}];
flat out vec4 vSegment;
#else
uniform vec3 translation;
uniform float stepM;
uniform vec2 uvScale;
uniform vec2 measureScale;
#endif
uniform vec3 eyeCoarse;
uniform vec3 eyeFine;
uniform float pushM;
uniform int mode;
uniform bool hasMap;
uniform sampler2DArray map;
#ifdef MINIATURE
uniform float modelScale;
#endif

out vec3 vTilt;
out vec3 vTint;
out vec2 vPlan;
out vec2 vSpot;
out vec2 vMeasure;
flat out float vRegion;
flat out float vLayer;

invariant gl_Position;

${IS_SHADED}
#ifndef MINIATURE
#include <fog_pars_vertex>
#include <clipping_planes_pars_vertex>
#endif
#if defined(SHADED) || defined(USE_LOGARITHMIC_DEPTH_BUFFER)
#include <common>
#endif
#include <logdepthbuf_pars_vertex>
#ifdef SHADED
// Else three.js would not move a point along its normal before it looks whether that is in shadow.
#define HAS_NORMAL
#include <shadowmap_pars_vertex>
out vec3 vViewPosition;
out vec3 vViewTilt;
#endif

void main() {
#ifdef PAGED
  // What differs between the segments of a page, by the number of the range.
  vec4 grid = traits[${TRAIT_VECTORS} * gl_DrawID];
  vec4 scales = traits[${TRAIT_VECTORS} * gl_DrawID + 1];
  vec3 translation = grid.xyz;
  float stepM = grid.w;
  vec2 uvScale = scales.xy;
  vec2 measureScale = scales.zw;
  vec4 own = traits[${TRAIT_VECTORS} * gl_DrawID + 2];
  vLayer = floor(own.w / 2.0);
  vSegment = vec4(own.rgb, own.w - 2.0 * vLayer);
#else
  vLayer = 0.0;
#endif
  vec3 place = translation + stepM * code.xyz;
  vec3 away = (place - eyeCoarse) - eyeFine;
#ifdef MINIATURE
  // Seen from the eye that the model's scale and place make of the real one; nothing stands before it to be pushed behind.
  away *= modelScale;
#else
#if defined(SHADED) || defined(USE_FOG) || NUM_CLIPPING_PLANES > 0
  // Where the ground is, not where the base is pushed to: both sides of a rim are lit, veiled and cut alike.
  vec4 mvPosition = vec4(mat3(modelViewMatrix) * away, 1.0);
#include <fog_vertex>
#include <clipping_planes_vertex>
#endif
#ifdef CASTER
  // Behind the detail as a light sees it, so that the base casts nothing on that; lights may see in parallel lines.
  vec3 parallel = normalize(inverse(mat3(modelViewMatrix)) * vec3(0.0, 0.0, -1.0));
  vec3 sight = isOrthographic ? parallel : away / max(length(away), 0.001);
  away += pushM * sight;
#else
  away += pushM * away / max(length(away), 0.001);
#endif
#endif
  gl_Position = projectionMatrix * vec4(mat3(modelViewMatrix) * away, 1.0);
#ifndef CASTER
  if (gl_Position.w > 0.0) {
#ifdef USE_REVERSED_DEPTH_BUFFER
    gl_Position.z = max(gl_Position.z, gl_Position.w * 0.000001);
#else
    gl_Position.z = min(gl_Position.z, gl_Position.w * 0.999999);
#endif
  }
#include <logdepthbuf_vertex>

  vPlan = place.xz;
  vTilt = tilt.xyz;
  vSpot = uvScale * spot;
  vTint = tint.rgb;
  if (hasMap && mode == ${MODE_NUMBER["vertex-colour"]}) {
    // Textured payloads have no vertex colours. A mip that mixes no foreign chart stands in for them.
    vTint = textureLod(map, vec3(vSpot, vLayer), 3.0).rgb;
  }
  vRegion = region.x;
  // 65535 means "no value"; a face with one such corner is grey.
  bool isNone = measure.x > 65534.5;
  vMeasure = vec2(isNone ? 0.0 : measureScale.x + measureScale.y * measure.x, isNone ? 1.0 : 0.0);
#endif

#ifdef SHADED
  vViewPosition = -mvPosition.xyz;
  vec3 transformedNormal = normalize(normalMatrix * tilt.xyz);
  vViewTilt = transformedNormal;
  // The base is known to within so much: detail that lies no higher above it does not shade it.
  vec4 worldPosition = modelMatrix * vec4(place + pushM * tilt.xyz, 1.0);
#include <shadowmap_vertex>
#endif
}
`;

/** See {@link VERTEX_SHADER}. Light is linear until the last line. */
export const FRAGMENT_SHADER = /* glsl */ `
precision highp float;
precision highp int;

in vec3 vTilt;
in vec3 vTint;
in vec2 vSpot;
in vec2 vMeasure;
in vec2 vPlan;
flat in float vRegion;
flat in float vLayer;
#ifdef PAGED
flat in vec4 vSegment;
#endif

uniform int mode;
uniform bool hasMap;
uniform bool hasTint;
uniform bool hasRegion;
uniform bool hasMeasure;
uniform sampler2DArray map;
uniform sampler2D regionColours;
uniform vec3 noValue;
uniform vec3 plain;
uniform vec2 measureRange;
// One row each. A texture: as uniforms they would be sent again for each segment.
uniform sampler2D ramps;
uniform float relief;
uniform float mapRelief;
uniform float highlight;
uniform vec3 freshColour;
uniform float fresh;
// What strokes taught: colours of names; alpha is doubt in 254ths, 255 without ground.
uniform sampler2D taught;
uniform vec2 taughtCorner;
uniform vec2 taughtSize;
uniform float taughtStripe;
uniform float taughtShare;
#ifdef COMPARED
// Left of it the base is drawn whole and alone (side -1), right of it detail (side 1): in pixels.
uniform float splitX;
#endif
uniform int side;

out vec4 outColour;
// As three.js calls it.
#define gl_FragColor outColour

${IS_SHADED}
#ifndef MINIATURE
#include <fog_pars_fragment>
#include <clipping_planes_pars_fragment>
#endif
#include <logdepthbuf_pars_fragment>
${LIGHT}
vec3 toLinear(vec3 c) {
  return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
}

// Mixed in sRGB, as a CSS gradient is: so legend and ground agree.
vec3 alongRamp(int row, float share) {
  float at = clamp(share, 0.0, 1.0) * ${(RAMP_STOPS - 1).toFixed(1)};
  int low = min(int(at), ${RAMP_STOPS - 2});
  vec3 under = texelFetch(ramps, ivec2(low, row), 0).rgb;
  return toLinear(mix(under, texelFetch(ramps, ivec2(low + 1, row), 0).rgb, at - float(low)));
}

// The survey's own look, paled: for what a mode has no colour for, so that it stays ground.
vec3 paled() {
  vec3 own = hasMap ? texture(map, vec3(vSpot, vLayer)).rgb : hasTint ? vTint : plain;
  return mix(own, vec3(dot(own, vec3(0.2126, 0.7152, 0.0722))), 0.8);
}

void main() {
#ifndef MINIATURE
#include <clipping_planes_fragment>
#endif
#ifdef COMPARED
  if (side != 0 && (gl_FragCoord.x < splitX) != (side < 0)) {
    discard;
  }
#endif
  vec3 tilt = normalize(vTilt);
  vec3 colour = plain;
  float strength = relief;
  if (mode == ${MODE_NUMBER.colour} || mode == ${MODE_NUMBER["vertex-colour"]}) {
    if (hasMap && mode == ${MODE_NUMBER.colour}) {
      colour = texture(map, vec3(vSpot, vLayer)).rgb;
      strength *= mapRelief;
    } else if (hasTint || hasMap) {
      colour = vTint;
      strength *= ${TINT_RELIEF};
    }
  } else if (mode == ${MODE_NUMBER.regions} || mode == ${MODE_NUMBER.names}) {
    colour = paled();
    ivec2 size = textureSize(regionColours, 0);
    int id = int(vRegion + 0.5);
    if (hasRegion && id / size.x < size.y) {
      vec4 own = texelFetch(regionColours, ivec2(id % size.x, id / size.x), 0);
      colour = own.a > 0.5 ? own.rgb : colour;
    }
  } else if (mode == ${MODE_NUMBER.segments}) {
#ifdef PAGED
    colour = vSegment.rgb;
#else
    colour = paled();
#endif
  } else if (mode == ${MODE_NUMBER.attribute}) {
    colour = noValue;
    strength *= 0.6; // Dark must remain "little of it".
    if (hasMeasure && vMeasure.y < 0.001) {
      float span = max(measureRange.y - measureRange.x, 1e-20);
      colour = alongRamp(0, (vMeasure.x - measureRange.x) / span);
    }
  } else {
    strength *= 0.3; // The colours are the relief.
    colour = alongRamp(1, degrees(acos(clamp(tilt.y, 0.0, 1.0))) / 90.0);
  }
  // Half a sky and a sun in the north-west, as on maps: level ground keeps its colour. The normal is not turned over for
  // back faces: the strip of a segment's underside that shows at the rim is to look like the ground it belongs to.
  float light = 0.32 + 0.25 * (0.5 + 0.5 * tilt.y) + 0.62 * max(dot(tilt, vec3(-0.5, 0.7071068, -0.5)), 0.0);
#ifdef LIT
  vec3 sun = lightOn(receiveShadow);
#elif defined(SHADED)
  vec3 sun = (lightOn(true) + UNLIT) / (lightOn(false) + UNLIT);
#endif
  colour *= LIGHT(strength);
  if (highlight > -0.5 && !(hasRegion && abs(vRegion - highlight) < 0.5)) {
    colour = 0.3 * mix(vec3(dot(colour, vec3(0.2126, 0.7152, 0.0722))), colour, 0.25);
  }
  if (taughtShare > 0.0) {
    vec2 at = (vPlan - taughtCorner) / taughtSize;
    vec4 name = texture(taught, at);
    if (name.a < 0.999 && clamp(at, 0.0, 1.0) == at) {
      // Unsure ground is striped, not paler: pale means nothing to whoever does not know the colour.
      bool isGap = name.a > 0.5 && fract((vPlan.x + vPlan.y) / taughtStripe) < 0.5;
      colour = mix(colour, name.rgb * LIGHT(0.8 * relief), isGap ? 0.08 : taughtShare);
    }
  }
#ifdef PAGED
  colour = mix(colour, freshColour, fresh * vSegment.a);
#endif
#include <logdepthbuf_fragment>
  gl_FragColor = vec4(colour, 1.0);
#include <tonemapping_fragment>
  gl_FragColor = linearToOutputTexel(gl_FragColor);
#ifndef MINIATURE
#include <fog_fragment>
#endif
}
`;

/** What casts a shadow leaves its depth alone. */
export const CASTER_SHADER = /* glsl */ `
out vec4 outColour;
#include <clipping_planes_pars_fragment>

void main() {
#include <clipping_planes_fragment>
  outColour = vec4(1.0);
}
`;
