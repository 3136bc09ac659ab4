#include "../../../Pipelines.hlsl"
