#pragma once

#include <cstddef>

namespace terraport_tests {

/// Calls of operator new, in any form, by this thread so far.
std::size_t allocationCount();

}  // namespace terraport_tests
