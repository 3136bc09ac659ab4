// The Universal Render Pipeline's lights on the ground: the main one and, in forward rendering, the additional ones; shadows, ambient.
#ifndef TERRAPORT_GROUND_LIT_UNIVERSAL_INCLUDED
#define TERRAPORT_GROUND_LIT_UNIVERSAL_INCLUDED

#include "Packages/com.unity.render-pipelines.universal/ShaderLibrary/Lighting.hlsl"
#include "TerraportGroundUniversal.hlsl"

// Of the light that a shadow map is drawn for; set by the pipeline.
float3 _LightDirection;
float3 _LightPosition;

struct LitVaryings
{
    float4 positionCS : SV_POSITION;
    float3 normal : TEXCOORD0;
    float3 tint : TEXCOORD1;
    float2 uv : TEXCOORD2;
    float fog : TEXCOORD3;
    float3 positionWS : TEXCOORD4;
    UNITY_VERTEX_OUTPUT_STEREO
};

LitVaryings LitVertex(Attributes input)
{
    LitVaryings output = (LitVaryings)0;
    UNITY_SETUP_INSTANCE_ID(input);
    UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output);
    // Lit where it is, not where it is pushed to: detail and base of one place get the same light.
    output.positionWS = TransformObjectToWorld(input.position.xyz);
    float3 eye = GetCameraPositionWS();
    float pushM = TerraportWorldPush((float3x3)UNITY_MATRIX_M, _TerraportPushM);
    float3 fromEye = TerraportPushBack(output.positionWS - eye, pushM);
    output.positionCS = TerraportKeepBeforeFar(mul(UNITY_MATRIX_P, float4(mul((float3x3)UNITY_MATRIX_V, fromEye), 1.0)));
    output.normal = TransformObjectToWorldNormal(input.normal);
    output.tint = TerraportTint(input.colour.rgb);
    output.uv = TRANSFORM_TEX(input.uv, _MainTex);
    output.fog = ComputeFogFactor(output.positionCS.z);
    return output;
}

float3 LightOf(Light light, float3 normal)
{
    return light.color * (light.distanceAttenuation * light.shadowAttenuation * saturate(dot(normal, light.direction)));
}

float4 LitFragment(LitVaryings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    float3 photo = SAMPLE_TEXTURE2D(_MainTex, sampler_MainTex, input.uv).rgb;
    float3 albedo = _TerraportHasPhoto > 0.5 ? photo : input.tint;
    // Not turned over for back faces: see TerraportShade.
    float3 normal = normalize(input.normal);
    float3 light = SampleSH(normal) + LightOf(GetMainLight(TransformWorldToShadowCoord(input.positionWS)), normal);
#if defined(_ADDITIONAL_LIGHTS)
    uint count = GetAdditionalLightsCount();
    for (uint number = 0u; number < count; ++number)
    {
        light += LightOf(GetAdditionalLight(number, input.positionWS, float4(1.0, 1.0, 1.0, 1.0)), normal);
    }
#endif
    return float4(MixFog(albedo * light, input.fog), 1.0);
}

struct ShadowVaryings
{
    float4 positionCS : SV_POSITION;
};

ShadowVaryings ShadowVertex(Attributes input)
{
    ShadowVaryings output;
    UNITY_SETUP_INSTANCE_ID(input);
    float3 positionWS = TransformObjectToWorld(input.position.xyz);
#if defined(_CASTING_PUNCTUAL_LIGHT_SHADOW)
    float3 toLight = normalize(_LightPosition - positionWS);
#else
    float3 toLight = _LightDirection;
#endif
    float3 normal = TransformObjectToWorldNormal(input.normal);
    output.positionCS = TransformWorldToHClip(ApplyShadowBias(positionWS, normal, toLight));
    // What lies behind the light casts all the same.
#if defined(UNITY_REVERSED_Z)
    output.positionCS.z = min(output.positionCS.z, output.positionCS.w * UNITY_NEAR_CLIP_VALUE);
#else
    output.positionCS.z = max(output.positionCS.z, output.positionCS.w * UNITY_NEAR_CLIP_VALUE);
#endif
    return output;
}

float4 ShadowFragment(ShadowVaryings input) : SV_Target
{
    return 0;
}

#endif
