// What of the built-in pipeline's includes the shaders use: enough for a compiler to read them.
#ifndef STUB_UNITY_CG
#define STUB_UNITY_CG
#include "Eyes.hlsl"
#if defined(STUB_SAMPLER2D)
// Compilers newer than Direct3D 9 do not know it; Unity's includes make it up in such a way, too.
struct sampler2D { Texture2D<float4> image; SamplerState state; };
float4 tex2D(sampler2D from, float2 uv) { return from.image.Sample(from.state, uv); }
#endif
float4 unity_LightShadowBias;
float4 unity_FogParams;
float4 unity_FogColor;
#define UNITY_REVERSED_Z 1
#define UNITY_INITIALIZE_OUTPUT(type, name) name = (type)0;
#if defined(FOG_LINEAR)
#define UNITY_FOG_COORDS(index) float fogCoord : TEXCOORD##index;
#define UNITY_TRANSFER_FOG(output, position) output.fogCoord = position.z * unity_FogParams.z + unity_FogParams.w
#define UNITY_APPLY_FOG_COLOR(coord, colour, fog) colour.rgb = lerp(fog.rgb, colour.rgb, saturate(coord))
#define UNITY_APPLY_FOG(coord, colour) colour.rgb = lerp(unity_FogColor.rgb, colour.rgb, saturate(coord))
#else
#define UNITY_FOG_COORDS(index)
#define UNITY_TRANSFER_FOG(output, position)
#define UNITY_APPLY_FOG_COLOR(coord, colour, fog)
#define UNITY_APPLY_FOG(coord, colour)
#endif
#define TRANSFORM_TEX(uv, name) (uv * name##_ST.xy + name##_ST.zw)
float3 UnityObjectToWorldNormal(float3 normal) { return normalize(mul(normal, (float3x3)unity_WorldToObject)); }
float4 UnityApplyLinearShadowBias(float4 position) { position.z += unity_LightShadowBias.x; return position; }
#endif
