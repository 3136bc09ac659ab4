// What of the built-in pipeline's lights the lit ground uses.
#ifndef STUB_LIGHTING
#define STUB_LIGHTING
#include "UnityCG.cginc"
float4 _LightColor0;
float4 _WorldSpaceLightPos0;
float4 unity_SHAr;
float3 ShadeSH9(float4 normal) { return unity_SHAr.rgb * dot(unity_SHAr, normal); }
float3 UnityWorldSpaceLightDir(float3 position) { return _WorldSpaceLightPos0.xyz - position * _WorldSpaceLightPos0.w; }
#endif
