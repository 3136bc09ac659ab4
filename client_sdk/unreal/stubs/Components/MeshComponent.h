#pragma once

#include "Components/PrimitiveComponent.h"
