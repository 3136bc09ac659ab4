// What both scriptable pipelines' includes have in common, as far as the shaders use it.
#ifndef STUB_PIPELINES
#define STUB_PIPELINES
#include "Eyes.hlsl"
#define UNITY_MATRIX_M unity_ObjectToWorld
#define UNITY_REVERSED_Z 1
#define CBUFFER_START(name) cbuffer name {
#define CBUFFER_END };
#define TEXTURE2D(name) Texture2D name
#define SAMPLER(name) SamplerState name
#define SAMPLE_TEXTURE2D(name, state, uv) name.Sample(state, uv)
#define TRANSFORM_TEX(uv, name) (uv * name##_ST.xy + name##_ST.zw)
float3 TransformObjectToWorld(float3 position) { return mul(UNITY_MATRIX_M, float4(position, 1.0)).xyz; }
float3 TransformObjectToWorldNormal(float3 normal) { return normalize(mul((float3x3)UNITY_MATRIX_M, normal)); }
float4 TransformWorldToHClip(float3 position) { return mul(UNITY_MATRIX_VP, float4(position, 1.0)); }
#endif
