#pragma once

#include <cstddef>

namespace terraport_tests {

/// Calls of operator new, in any form, by this thread so far.
std::size_t allocationCount();

/// Bytes that this thread asked operator new for so far.
std::size_t allocatedBytes();

}  // namespace terraport_tests
