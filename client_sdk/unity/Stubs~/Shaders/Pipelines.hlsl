// What both scriptable pipelines' includes have in common, as far as the shaders use it.
#ifndef STUB_PIPELINES
#define STUB_PIPELINES
float4x4 UNITY_MATRIX_M;
float4x4 UNITY_MATRIX_V;
float4x4 UNITY_MATRIX_P;
float4x4 UNITY_MATRIX_VP;
#define UNITY_REVERSED_Z 1
#define UNITY_VERTEX_INPUT_INSTANCE_ID
#define UNITY_VERTEX_OUTPUT_STEREO
#define UNITY_SETUP_INSTANCE_ID(input)
#define UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output)
#define UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input)
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
