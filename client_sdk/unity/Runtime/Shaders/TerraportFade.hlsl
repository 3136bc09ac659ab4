// A face over the whole picture: its corners are the picture's, whichever camera and eye.
#ifndef TERRAPORT_FADE_INCLUDED
#define TERRAPORT_FADE_INCLUDED

#include "UnityCG.cginc"

float _TerraportFade;

struct Attributes
{
    float4 position : POSITION;
    UNITY_VERTEX_INPUT_INSTANCE_ID
};

struct Varyings
{
    float4 positionCS : SV_POSITION;
    UNITY_VERTEX_OUTPUT_STEREO
};

Varyings FadeVertex(Attributes input)
{
    Varyings output;
    UNITY_SETUP_INSTANCE_ID(input);
    UNITY_INITIALIZE_OUTPUT(Varyings, output);
    UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output);
    // Within the depths of every graphics API; depth is not looked at.
    output.positionCS = float4(input.position.xy, 0.5, 1.0);
    return output;
}

float4 FadeFragment(Varyings input) : SV_Target
{
    UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input);
    return float4(0.0, 0.0, 0.0, _TerraportFade);
}

#endif
