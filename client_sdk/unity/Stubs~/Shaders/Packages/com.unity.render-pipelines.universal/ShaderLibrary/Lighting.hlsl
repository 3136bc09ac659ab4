// What of URP's lights the lit ground uses: names, parameters and results as the pipeline's shader library has them.
#ifndef STUB_LIGHTING
#define STUB_LIGHTING
#include "Core.hlsl"
#define UNITY_NEAR_CLIP_VALUE 1.0
struct Light { float3 direction; float3 color; float distanceAttenuation; float shadowAttenuation; uint layerMask; };
float4 stub_MainLight;
float4 stub_SH;
float4x4 stub_WorldToShadow;
uint stub_LightCount;
float3 SampleSH(float3 normal) { return stub_SH.rgb * normal.y; }
float4 TransformWorldToShadowCoord(float3 position) { return mul(stub_WorldToShadow, float4(position, 1.0)); }
Light StubLight(float shadow) { Light light; light.direction = stub_MainLight.xyz; light.color = stub_SH.rgb; light.distanceAttenuation = 1.0; light.shadowAttenuation = shadow; light.layerMask = 0u; return light; }
#if defined(_MAIN_LIGHT_SHADOWS)
Light GetMainLight(float4 shadowCoord) { return StubLight(shadowCoord.z); }
#else
Light GetMainLight(float4 shadowCoord) { return StubLight(1.0); }
#endif
uint GetAdditionalLightsCount() { return stub_LightCount; }
Light GetAdditionalLight(uint number, float3 position, float4 shadowMask) { return StubLight(shadowMask.x * float(number)); }
float3 ApplyShadowBias(float3 position, float3 normal, float3 direction) { return position + direction * 0.01 + normal * 0.01; }
#endif
