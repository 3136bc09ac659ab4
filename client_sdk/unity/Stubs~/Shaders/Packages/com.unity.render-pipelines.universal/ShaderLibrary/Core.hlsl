#ifndef STUB_CORE
#define STUB_CORE
#include "../../../Pipelines.hlsl"
float4 unity_FogColor;
float3 GetCameraPositionWS() { return _WorldSpaceCameraPos; }
float ComputeFogFactor(float z) { return z; }
float3 MixFog(float3 colour, float factor) { return lerp(unity_FogColor.rgb, colour, saturate(factor)); }
#endif
