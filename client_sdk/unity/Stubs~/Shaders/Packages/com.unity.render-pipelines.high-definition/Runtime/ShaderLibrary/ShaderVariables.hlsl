#include "../../../../Pipelines.hlsl"
float3 GetPrimaryCameraPosition() { return float3(0.0, 0.0, 0.0); }
