// Draws base and segments, in every look. Light is linear until the last line, as in the viewer (ground-shader.ts), so that
// both show the same ground alike.
shader_type spatial;
render_mode unshaded, cull_disabled, skip_vertex_transform;

// What is drawn: 0 colour, 1 regions, 2 segments, 3 the attribute, 4 slope. TerraportScene sets it.
uniform int look = 0;
// How much of the shape's light is laid over the ground; 0 where the engine lights it.
uniform float relief = 1.0;
uniform float attribute_min = 0.0;
uniform float attribute_max = 1.0;
uniform sampler2D ramp : hint_albedo;

// Of each mesh; the library sets them.
uniform sampler2D map : hint_albedo;
uniform bool has_map = false;
uniform bool has_tint = false;
// The image is of the points' colours, and shaded as they are; a photograph has its own light.
uniform bool map_of_points = false;
// Metres that the base is pushed back along the line of sight: a point stays on its pixel.
uniform float push_m = 0.0;
uniform float segment = -1.0;

varying vec3 tilt;
// Linear light: mixed over a face as the viewer mixes it.
varying vec3 tint;
varying flat float region;

vec3 to_linear(vec3 c) {
	return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
}

vec3 to_srgb(vec3 c) {
	return mix(c * 12.92, 1.055 * pow(max(c, vec3(0.0)), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}

// Neighbouring numbers get far hues: steps of the golden ratio.
vec3 hue_of(float number) {
	float hue = fract(number * 0.6180340) * 6.0;
	float level = 0.75 + 0.2 * mod(number, 3.0) / 2.0;
	vec3 pure = clamp(vec3(abs(hue - 3.0) - 1.0, 2.0 - abs(hue - 2.0), 2.0 - abs(hue - 4.0)), 0.0, 1.0);
	return to_linear(level * mix(vec3(1.0), pure, 0.55));
}

void vertex() {
	tilt = NORMAL;
	tint = to_linear(COLOR.rgb);
	region = UV2.x;
	vec3 away = (MODELVIEW_MATRIX * vec4(VERTEX, 1.0)).xyz;
	VERTEX = away + push_m * away / max(length(away), 0.001);
	NORMAL = normalize((MODELVIEW_MATRIX * vec4(NORMAL, 0.0)).xyz);
}

void fragment() {
	vec3 up = normalize(tilt);
	vec3 own = to_linear(vec3(0.63, 0.6, 0.55));
	float strength = relief;
	if (has_map) {
		own = texture(map, UV).rgb;
		if (OUTPUT_IS_SRGB) {
			own = to_linear(own);
		}
		strength *= map_of_points ? 0.35 : 0.0;
	} else if (has_tint) {
		own = tint;
		strength *= 0.35;
	}
	vec3 colour = own;
	if (look > 0) {
		strength = relief;
		vec3 pale = mix(own, vec3(dot(own, vec3(0.2126, 0.7152, 0.0722))), 0.8);
		if (look == 1) {
			colour = region < -0.5 ? pale : hue_of(floor(region + 0.5));
		} else if (look == 2) {
			colour = segment < -0.5 ? pale : hue_of(segment);
		} else {
			float share = (UV2.y - attribute_min) / max(attribute_max - attribute_min, 1.0e-20);
			if (look == 4) {
				share = degrees(acos(clamp(up.y, 0.0, 1.0))) / 90.0;
				strength *= 0.3;
			}
			vec3 along = texture(ramp, vec2(clamp(share, 0.002, 0.998), 0.5)).rgb;
			if (OUTPUT_IS_SRGB) {
				along = to_linear(along);
			}
			// A face with one corner that has no value is pale.
			colour = look == 3 && UV2.y < -1.0e20 ? pale : along;
		}
	}
	// Half a sky and a sun in the north-west, as on maps: level ground keeps its colour.
	float light = 0.32 + 0.25 * (0.5 + 0.5 * up.y) + 0.62 * max(dot(up, vec3(-0.5, 0.7071068, -0.5)), 0.0);
	colour *= mix(1.0, light, strength);
	ALBEDO = OUTPUT_IS_SRGB ? to_srgb(colour) : colour;
}
