// What of the built-in pipeline's includes the shaders use, without stereo: enough for a compiler to read them.
#ifndef STUB_UNITY_CG
#define STUB_UNITY_CG
float4x4 unity_ObjectToWorld;
float4x4 unity_WorldToObject;
float4x4 UNITY_MATRIX_V;
float4x4 UNITY_MATRIX_P;
float4x4 UNITY_MATRIX_VP;
float3 _WorldSpaceCameraPos;
float4 unity_LightShadowBias;
float4 unity_FogParams;
float4 unity_FogColor;
#define UNITY_REVERSED_Z 1
#define UNITY_VERTEX_INPUT_INSTANCE_ID
#define UNITY_VERTEX_OUTPUT_STEREO
#define UNITY_SETUP_INSTANCE_ID(input)
#define UNITY_INITIALIZE_OUTPUT(type, name) name = (type)0;
#define UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output)
#define UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input)
#define UNITY_FOG_COORDS(index) float fogCoord : TEXCOORD##index;
#define UNITY_TRANSFER_FOG(output, position) output.fogCoord = position.z * unity_FogParams.z + unity_FogParams.w
#define UNITY_APPLY_FOG(coord, colour) colour.rgb = lerp(unity_FogColor.rgb, colour.rgb, saturate(coord))
#define TRANSFORM_TEX(uv, name) (uv * name##_ST.xy + name##_ST.zw)
float3 UnityObjectToWorldNormal(float3 normal) { return normalize(mul(normal, (float3x3)unity_WorldToObject)); }
float4 UnityApplyLinearShadowBias(float4 position) { position.z += unity_LightShadowBias.x; return position; }
#endif
