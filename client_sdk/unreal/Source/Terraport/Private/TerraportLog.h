#pragma once

#include "CoreMinimal.h"

/** Connections, failures, settings that will not do. Never a token. */
DECLARE_LOG_CATEGORY_EXTERN(LogTerraport, Log, All);
