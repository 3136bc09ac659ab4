// What crosses the border of the module TerraportCore carries TERRAPORTCORE_API. Unreal's build tool defines it; elsewhere
// it is nothing.
#pragma once

#ifndef TERRAPORTCORE_API
#define TERRAPORTCORE_API
#endif
