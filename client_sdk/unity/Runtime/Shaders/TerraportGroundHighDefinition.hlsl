// The High Definition Render Pipeline: a hand-written unlit pass and its depth. HDRP draws relative to the camera.
#ifndef TERRAPORT_GROUND_HIGH_DEFINITION_INCLUDED
#define TERRAPORT_GROUND_HIGH_DEFINITION_INCLUDED

#include "Packages/com.unity.render-pipelines.core/ShaderLibrary/Common.hlsl"
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/ShaderLibrary/ShaderVariables.hlsl"
#include "TerraportGround.hlsl"
#include "TerraportGroundAttributes.hlsl"

TEXTURE2D(_MainTex);
SAMPLER(sampler_MainTex);

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
    UNITY_VERTEX_OUTPUT_STEREO
};

Varyings GroundVertex(Attributes input)
{
    Varyings output = (Varyings)0;
    UNITY_SETUP_INSTANCE_ID(input);
    UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output);
    float3 eye = GetPrimaryCameraPosition(); // 0 where positions are relative to the camera, as they are by default.
    float pushM = TerraportWorldPush((float3x3)UNITY_MATRIX_M, _TerraportPushM);
    float3 place = eye + TerraportPushBack(TransformObjectToWorld(input.position.xyz) - eye, pushM);
    output.positionCS = TerraportKeepBeforeFar(TransformWorldToHClip(place));
    output.normal = TransformObjectToWorldNormal(input.normal);
    output.tint = input.colour.rgb;
    output.uv = TRANSFORM_TEX(input.uv, _MainTex);
    return output;
}

float4 GroundFragment(Varyings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    float3 photo = SAMPLE_TEXTURE2D(_MainTex, sampler_MainTex, input.uv).rgb;
    // Unlit colours are not exposed in HDRP either: what a survey recorded is shown as it is, whatever the scene's light.
    return float4(TerraportColour(input.tint, photo, _TerraportHasPhoto, input.normal, _TerraportRelief), 1.0);
}

void DepthFragment(Varyings input)
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
}

#endif
