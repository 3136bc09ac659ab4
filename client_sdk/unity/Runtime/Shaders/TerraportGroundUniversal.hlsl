// The Universal Render Pipeline.
#ifndef TERRAPORT_GROUND_UNIVERSAL_INCLUDED
#define TERRAPORT_GROUND_UNIVERSAL_INCLUDED

#include "Packages/com.unity.render-pipelines.universal/ShaderLibrary/Core.hlsl"
#include "TerraportGround.hlsl"
#include "TerraportGroundAttributes.hlsl"

TEXTURE2D(_MainTex);
SAMPLER(sampler_MainTex);

// One block for all passes, so that the SRP Batcher takes the shader.
CBUFFER_START(UnityPerMaterial)
float4 _MainTex_ST;
float _TerraportPushM;
float _TerraportRelief;
float _TerraportHasPhoto;
CBUFFER_END

struct Varyings
{
    float4 positionCS : SV_POSITION;
    float3 normal : TEXCOORD0;
    float3 tint : TEXCOORD1;
    float2 uv : TEXCOORD2;
    float fog : TEXCOORD3;
    UNITY_VERTEX_OUTPUT_STEREO
};

Varyings GroundVertex(Attributes input)
{
    Varyings output = (Varyings)0;
    UNITY_SETUP_INSTANCE_ID(input);
    UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output);
    float3 eye = GetCameraPositionWS(); // This eye's, with single-pass stereo.
    float pushM = TerraportWorldPush((float3x3)UNITY_MATRIX_M, _TerraportPushM);
    float3 fromEye = TerraportPushBack(TransformObjectToWorld(input.position.xyz) - eye, pushM);
    output.positionCS = TerraportKeepBeforeFar(mul(UNITY_MATRIX_P, float4(mul((float3x3)UNITY_MATRIX_V, fromEye), 1.0)));
    output.normal = TransformObjectToWorldNormal(input.normal);
    output.tint = TerraportTint(input.colour.rgb);
    output.uv = TRANSFORM_TEX(input.uv, _MainTex);
    output.fog = ComputeFogFactor(output.positionCS.z);
    return output;
}

float4 GroundFragment(Varyings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    float3 photo = SAMPLE_TEXTURE2D(_MainTex, sampler_MainTex, input.uv).rgb;
    float3 colour = TerraportColour(input.tint, photo, _TerraportHasPhoto, input.normal, _TerraportRelief);
    return float4(MixFog(colour, input.fog), 1.0);
}

float4 DepthFragment(Varyings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    return input.positionCS.z;
}

float4 DepthNormalsFragment(Varyings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    return float4(normalize(input.normal), 0.0);
}

#endif
