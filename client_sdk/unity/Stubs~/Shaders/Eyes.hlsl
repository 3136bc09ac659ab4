// What instancing and both eyes in one pass do to a shader, as Unity's macros do it: matrices become arrays, a vertex brings a
// number that says which eye, its output carries that on, and whoever forgets one of the steps reads what nobody wrote.
#ifndef STUB_EYES
#define STUB_EYES

#if defined(STEREO_INSTANCING_ON) || defined(STEREO_MULTIVIEW_ON)
static uint unity_StereoEyeIndex;
#elif defined(UNITY_SINGLE_PASS_STEREO)
cbuffer UnityStereoEyeIndex { int unity_StereoEyeIndex; };
#endif

#if defined(STEREO_INSTANCING_ON) || defined(STEREO_MULTIVIEW_ON) || defined(UNITY_SINGLE_PASS_STEREO)
cbuffer UnityStereoGlobals
{
    float4x4 unity_StereoMatrixP[2];
    float4x4 unity_StereoMatrixV[2];
    float4x4 unity_StereoMatrixVP[2];
    float3 unity_StereoWorldSpaceCameraPos[2];
};
#define UNITY_MATRIX_P unity_StereoMatrixP[unity_StereoEyeIndex]
#define UNITY_MATRIX_V unity_StereoMatrixV[unity_StereoEyeIndex]
#define UNITY_MATRIX_VP unity_StereoMatrixVP[unity_StereoEyeIndex]
#define _WorldSpaceCameraPos unity_StereoWorldSpaceCameraPos[unity_StereoEyeIndex]
#else
float4x4 UNITY_MATRIX_P;
float4x4 UNITY_MATRIX_V;
float4x4 UNITY_MATRIX_VP;
float3 _WorldSpaceCameraPos;
#endif

#if defined(INSTANCING_ON) || defined(STEREO_INSTANCING_ON)
static uint unity_InstanceID;
struct StubInstance { float4x4 toWorld; float4x4 toObject; };
cbuffer UnityInstancing_PerDraw0 { StubInstance unity_Builtins0Array[2]; };
#define unity_ObjectToWorld unity_Builtins0Array[unity_InstanceID].toWorld
#define unity_WorldToObject unity_Builtins0Array[unity_InstanceID].toObject
#define UNITY_VERTEX_INPUT_INSTANCE_ID uint instanceID : SV_InstanceID;
#if defined(STEREO_INSTANCING_ON)
#define UNITY_SETUP_INSTANCE_ID(input) { unity_StereoEyeIndex = input.instanceID & 1; unity_InstanceID = input.instanceID >> 1; }
#else
#define UNITY_SETUP_INSTANCE_ID(input) { unity_InstanceID = input.instanceID; }
#endif
#else
float4x4 unity_ObjectToWorld;
float4x4 unity_WorldToObject;
#if defined(STEREO_MULTIVIEW_ON)
#define UNITY_VERTEX_INPUT_INSTANCE_ID uint view : SV_ViewID;
#define UNITY_SETUP_INSTANCE_ID(input) { unity_StereoEyeIndex = input.view; }
#else
#define UNITY_VERTEX_INPUT_INSTANCE_ID
#define UNITY_SETUP_INSTANCE_ID(input)
#endif
#endif

#if defined(STEREO_INSTANCING_ON)
#define UNITY_VERTEX_OUTPUT_STEREO uint stereoTargetEyeIndexAsRTArrayIdx : SV_RenderTargetArrayIndex;
#define UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output) output.stereoTargetEyeIndexAsRTArrayIdx = unity_StereoEyeIndex;
#define UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input) unity_StereoEyeIndex = input.stereoTargetEyeIndexAsRTArrayIdx;
#elif defined(STEREO_MULTIVIEW_ON)
#define UNITY_VERTEX_OUTPUT_STEREO float stereoTargetEyeIndexAsBlendIdx0 : BLENDWEIGHT0;
#define UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output) output.stereoTargetEyeIndexAsBlendIdx0 = unity_StereoEyeIndex;
#define UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input) unity_StereoEyeIndex = (uint)input.stereoTargetEyeIndexAsBlendIdx0;
#else
#define UNITY_VERTEX_OUTPUT_STEREO
#define UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output)
#define UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input)
#endif

#endif
