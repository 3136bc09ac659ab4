// The built-in pipeline's lights on the ground: one pass for the brightest light, ambient and the weak ones, one for each other light.
#ifndef TERRAPORT_GROUND_LIT_BUILTIN_INCLUDED
#define TERRAPORT_GROUND_LIT_BUILTIN_INCLUDED

#include "TerraportGroundBuiltIn.hlsl"
#include "Lighting.cginc"
#include "AutoLight.cginc"

struct LitVaryings
{
    // So named, since the engine's shadow macros read it.
    float4 pos : SV_POSITION;
    float3 normal : TEXCOORD0;
    float3 tint : TEXCOORD1;
    float2 uv : TEXCOORD2;
    float3 positionWS : TEXCOORD3;
    UNITY_FOG_COORDS(4)
    UNITY_SHADOW_COORDS(5)
    UNITY_VERTEX_OUTPUT_STEREO
};

LitVaryings LitVertex(Attributes input)
{
    LitVaryings output;
    UNITY_SETUP_INSTANCE_ID(input);
    UNITY_INITIALIZE_OUTPUT(LitVaryings, output);
    UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output);
    // Lit where it is, not where it is pushed to: detail and base of one place get the same light.
    output.positionWS = mul(unity_ObjectToWorld, float4(input.position.xyz, 1.0)).xyz;
    float pushM = TerraportWorldPush((float3x3)unity_ObjectToWorld, _TerraportPushM);
    float3 fromEye = TerraportPushBack(output.positionWS - _WorldSpaceCameraPos, pushM);
    output.pos = TerraportKeepBeforeFar(mul(UNITY_MATRIX_P, float4(mul((float3x3)UNITY_MATRIX_V, fromEye), 1.0)));
    output.normal = UnityObjectToWorldNormal(input.normal);
    output.tint = TerraportTint(input.colour.rgb);
    output.uv = TRANSFORM_TEX(input.uv, _MainTex);
    UNITY_TRANSFER_SHADOW(output, float2(0.0, 0.0));
    UNITY_TRANSFER_FOG(output, output.pos);
    return output;
}

float3 AlbedoOf(LitVaryings input)
{
    return _TerraportHasPhoto > 0.5 ? tex2D(_MainTex, input.uv).rgb : input.tint;
}

// Of the pass's light. Not turned over for back faces: see TerraportShade.
float3 LightOf(LitVaryings input, float3 normal)
{
    UNITY_LIGHT_ATTENUATION(attenuation, input, input.positionWS);
    float3 toLight = normalize(UnityWorldSpaceLightDir(input.positionWS));
    return _LightColor0.rgb * (attenuation * saturate(dot(normal, toLight)));
}

float4 LitFragment(LitVaryings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    float3 normal = normalize(input.normal);
    float3 light = ShadeSH9(float4(normal, 1.0)) + LightOf(input, normal);
    float4 colour = float4(AlbedoOf(input) * light, 1.0);
    UNITY_APPLY_FOG(input.fogCoord, colour);
    return colour;
}

float4 AddFragment(LitVaryings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    float4 colour = float4(AlbedoOf(input) * LightOf(input, normalize(input.normal)), 1.0);
    // Added to what is there already: fog takes from it, and gives nothing.
    UNITY_APPLY_FOG_COLOR(input.fogCoord, colour, float4(0.0, 0.0, 0.0, 0.0));
    return colour;
}

#endif
