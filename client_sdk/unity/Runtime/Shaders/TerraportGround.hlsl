// What all pipelines have in common: where the base goes, and how ground is coloured. No names of any pipeline in here.
#ifndef TERRAPORT_GROUND_INCLUDED
#define TERRAPORT_GROUND_INCLUDED

// Clip positions are made from what a vertex has to the eye, by the view's rotation alone: the large numbers of a place far from the
// origin cancel before they are turned, so a head's movement is not rounded. Equal positions stay equal: no crack opens.

// The vertex as seen from the eye, pushed back along the line of sight: it stays on its pixel, so outlines do not change and no slit
// can open (docs/topics/hand-off.md). pushM is the scene's deviation for the base, and 0 for detail.
float3 TerraportPushBack(float3 fromEye, float pushM)
{
    return fromEye + fromEye * (pushM / max(length(fromEye), 0.001));
}

// The deviation is in metres of the scene; a scene that is drawn smaller, as a model on a table, is pushed back by less of the world's.
float TerraportWorldPush(float3x3 objectToWorld, float pushM)
{
    return pushM * length(mul(objectToWorld, float3(0.0, 1.0, 0.0)));
}

// What would be pushed beyond the far plane is drawn just before it, and so still before the sky.
float4 TerraportKeepBeforeFar(float4 positionCS)
{
    if (positionCS.w > 0.0)
    {
#if defined(UNITY_REVERSED_Z)
        positionCS.z = max(positionCS.z, positionCS.w * 0.000001);
#else
        positionCS.z = min(positionCS.z, positionCS.w * 0.999999);
#endif
    }
    return positionCS;
}

// Half a sky and a sun in the north-west, as on maps: level ground keeps its colour. Unity's Z is north. The normal is not turned over
// for back faces: the strip of a segment's underside that shows at the rim is to look like the ground it belongs to.
float3 TerraportShade(float3 colour, float3 normal, float relief)
{
    float3 up = normalize(normal);
    float light = 0.32 + 0.25 * (0.5 + 0.5 * up.y) + 0.62 * max(dot(up, float3(-0.5, 0.7071068, 0.5)), 0.0);
    return colour * lerp(1.0, light, relief);
}

// A photograph (1) has its own light; an image of the points' colours (2) is lit as vertex colours (0) are.
float3 TerraportColour(float3 tint, float3 photo, float hasPhoto, float3 normal, float relief)
{
    float3 colour = hasPhoto > 0.5 ? photo : tint;
    return hasPhoto > 0.5 && hasPhoto < 1.5 ? colour : TerraportShade(colour, normal, relief);
}

// Vertex colours are linear light; a project in the gamma colour space wants them as the screen does.
float3 TerraportTint(float3 linearTint)
{
#if defined(UNITY_COLORSPACE_GAMMA)
    // No ?: of vectors: HLSL of 2021 refuses it.
    return lerp(linearTint * 12.92, 1.055 * pow(max(linearTint, 0.0), 1.0 / 2.4) - 0.055, step(0.0031308, linearTint));
#else
    return linearTint;
#endif
}

#endif
