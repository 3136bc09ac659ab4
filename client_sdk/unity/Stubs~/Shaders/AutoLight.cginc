// What of the built-in pipeline's shadows the lit ground uses: with them a vertex carries a place in the map, without them nothing.
#ifndef STUB_AUTO_LIGHT
#define STUB_AUTO_LIGHT
#if defined(SHADOWS_SCREEN)
#define UNITY_SHADOW_COORDS(index) float4 _ShadowCoord : TEXCOORD##index;
#define UNITY_TRANSFER_SHADOW(output, uv) output._ShadowCoord = output.pos;
#define UNITY_LIGHT_ATTENUATION(name, input, position) float name = input._ShadowCoord.z;
#else
#define UNITY_SHADOW_COORDS(index)
#define UNITY_TRANSFER_SHADOW(output, uv)
#define UNITY_LIGHT_ATTENUATION(name, input, position) float name = 1.0;
#endif
#endif
