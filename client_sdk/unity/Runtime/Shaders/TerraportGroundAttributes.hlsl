// What a vertex brings, as MeshFiller lays it out. To be included after the pipeline, whose instancing macro it uses.
#ifndef TERRAPORT_GROUND_ATTRIBUTES_INCLUDED
#define TERRAPORT_GROUND_ATTRIBUTES_INCLUDED

struct Attributes
{
    float4 position : POSITION;
    float3 normal : NORMAL;
    float4 colour : COLOR;
    float2 uv : TEXCOORD0;
    UNITY_VERTEX_INPUT_INSTANCE_ID
};

#endif
