// Darkness over everything a camera draws, in both eyes; see TerraportTeleport. In Resources, so that a build takes it along.
Shader "Terraport/Fade"
{
    Properties
    {
        _TerraportFade ("Darkness", Range(0, 1)) = 0
    }

    SubShader
    {
        Tags { "RenderType" = "Transparent" "Queue" = "Overlay" "IgnoreProjector" = "True" }
        Cull Off
        ZTest Always
        ZWrite Off
        Blend SrcAlpha OneMinusSrcAlpha

        Pass
        {
            // Without a light mode: what all pipelines draw.
            Name "Fade"
            CGPROGRAM
            #pragma target 3.0
            #pragma vertex FadeVertex
            #pragma fragment FadeFragment
            #pragma multi_compile_instancing
            #include "../Shaders/TerraportFade.hlsl"
            ENDCG
        }
    }
}
