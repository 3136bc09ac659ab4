// The built-in pipeline: one pass, no lights of the scene (the survey's colours have theirs).
#ifndef TERRAPORT_GROUND_BUILTIN_INCLUDED
#define TERRAPORT_GROUND_BUILTIN_INCLUDED

#include "UnityCG.cginc"
#include "TerraportGround.hlsl"
#include "TerraportGroundAttributes.hlsl"

sampler2D _MainTex;
float4 _MainTex_ST;
float _TerraportPushM;
float _TerraportRelief;
float _TerraportHasPhoto;

struct Varyings
{
    float4 positionCS : SV_POSITION;
    float3 normal : TEXCOORD0;
    float3 tint : TEXCOORD1;
    float2 uv : TEXCOORD2;
    UNITY_FOG_COORDS(3)
    UNITY_VERTEX_OUTPUT_STEREO
};

Varyings GroundVertex(Attributes input)
{
    Varyings output;
    UNITY_SETUP_INSTANCE_ID(input);
    UNITY_INITIALIZE_OUTPUT(Varyings, output);
    UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output);
    // From this eye: with single-pass stereo _WorldSpaceCameraPos is the eye's own.
    float3 fromEye = mul(unity_ObjectToWorld, float4(input.position.xyz, 1.0)).xyz - _WorldSpaceCameraPos;
    fromEye = TerraportPushBack(fromEye, TerraportWorldPush((float3x3)unity_ObjectToWorld, _TerraportPushM));
    output.positionCS = TerraportKeepBeforeFar(mul(UNITY_MATRIX_P, float4(mul((float3x3)UNITY_MATRIX_V, fromEye), 1.0)));
    output.normal = UnityObjectToWorldNormal(input.normal);
    output.tint = TerraportTint(input.colour.rgb);
    output.uv = TRANSFORM_TEX(input.uv, _MainTex);
    UNITY_TRANSFER_FOG(output, output.positionCS);
    return output;
}

float4 GroundFragment(Varyings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    float3 photo = tex2D(_MainTex, input.uv).rgb;
    float4 colour = float4(TerraportColour(input.tint, photo, _TerraportHasPhoto, input.normal, _TerraportRelief), 1.0);
    UNITY_APPLY_FOG(input.fogCoord, colour);
    return colour;
}

// Shadows and the depth texture.
struct DepthVaryings
{
    float4 positionCS : SV_POSITION;
    UNITY_VERTEX_OUTPUT_STEREO
};

DepthVaryings DepthVertex(Attributes input)
{
    DepthVaryings output;
    UNITY_SETUP_INSTANCE_ID(input);
    UNITY_INITIALIZE_OUTPUT(DepthVaryings, output);
    UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output);
    float3 world = mul(unity_ObjectToWorld, float4(input.position.xyz, 1.0)).xyz;
    // Without a bias of lights this is the camera's depth texture, where the base stands as far back as it is drawn.
    if (unity_LightShadowBias.z == 0.0)
    {
        float pushM = TerraportWorldPush((float3x3)unity_ObjectToWorld, _TerraportPushM);
        float3 fromEye = TerraportPushBack(world - _WorldSpaceCameraPos, pushM);
        output.positionCS = TerraportKeepBeforeFar(mul(UNITY_MATRIX_P, float4(mul((float3x3)UNITY_MATRIX_V, fromEye), 1.0)));
        return output;
    }
    output.positionCS = UnityApplyLinearShadowBias(mul(UNITY_MATRIX_VP, float4(world, 1.0)));
    return output;
}

float4 DepthFragment(DepthVaryings input) : SV_Target
{
    return 0;
}

#endif
