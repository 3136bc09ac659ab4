#include <doctest/doctest.h>

#include <vector>

#include "Terraport/Xxh3.h"

using terraport::xxh3Hash64;

namespace {

/// Bytes that any language makes alike.
std::vector<std::uint8_t> pattern(std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  std::uint32_t state = 2654435769U;
  for (std::uint8_t& byte : bytes) {
    byte = static_cast<std::uint8_t>(state >> 24);
    state = state * 1664525U + 1013904223U;
  }
  return bytes;
}

struct Case {
  std::size_t size;
  std::uint64_t hash;
};

// By the Python package xxhash 4.1.0 over the same bytes.
const Case kCases[] = {
    {0, 0x2d06800538d394c2ULL},
    {1, 0xdd02fbe6d2c66464ULL},
    {2, 0x425abbf69c907587ULL},
    {3, 0x2ea4896a8df78a20ULL},
    {4, 0x5054c7cbc7993863ULL},
    {5, 0xf0539b144d0ccacaULL},
    {6, 0x7b5df259d6594aa9ULL},
    {7, 0x758800f4d090189bULL},
    {8, 0xac908b94c405606bULL},
    {9, 0x928f3423761ad3c1ULL},
    {10, 0x29d53a4466ac6832ULL},
    {11, 0x112894aaf38c9bd1ULL},
    {12, 0x8cdcc386d66be847ULL},
    {13, 0x63aa555ec1f46f1fULL},
    {14, 0x5d5bdc7a79218138ULL},
    {15, 0xbf56bdb3eb554035ULL},
    {16, 0x3bb01f41e60b1737ULL},
    {17, 0x6dcdd6d7170ae509ULL},
    {18, 0x1f27cec8f7dc57d6ULL},
    {19, 0xd0b713d161b928acULL},
    {31, 0x1d9997a7a6993c47ULL},
    {32, 0xb131072fce7f89eaULL},
    {33, 0x2075988a4abf0b70ULL},
    {63, 0xbf0ac2b9a72d73d8ULL},
    {64, 0x196966a86b930cdeULL},
    {65, 0x1b0804343fa98102ULL},
    {95, 0xd5cfe595b04be154ULL},
    {96, 0xec0dfedcfef480c5ULL},
    {97, 0xe789b47ed04b12ffULL},
    {127, 0xf2546357666251d2ULL},
    {128, 0x56b56137fbcad9ebULL},
    {129, 0x7fb55812ebfaf136ULL},
    {130, 0x65ddd319b128afa4ULL},
    {143, 0x1f0e69fadf9124f1ULL},
    {144, 0xd7667b2f6a5d4d37ULL},
    {145, 0x89a8d1e8d5a37c91ULL},
    {191, 0x6bfbb6678c82f704ULL},
    {192, 0xcaed448672abee5aULL},
    {239, 0xcc25ae9bf347403fULL},
    {240, 0xc93a3baed9c04680ULL},
    {241, 0xe0e22db718843f1eULL},
    {242, 0xdcb9893f836cf6b3ULL},
    {255, 0x820076a61de64baaULL},
    {256, 0x7d940b9fbe9e3db8ULL},
    {257, 0xb5a8467cba57c7d6ULL},
    {319, 0xe3badc19eeddf46cULL},
    {320, 0xea7fd9b8dd89997eULL},
    {321, 0x74a4dcc433c044faULL},
    {511, 0xc12de749700a2f3bULL},
    {512, 0xf503880b03372167ULL},
    {1023, 0xb14a73680b7e4bdbULL},
    {1024, 0xe81c4fe32a3e186dULL},
    {1025, 0xbebdc6ef71d27095ULL},
    {1087, 0xbd31d481fbcd2688ULL},
    {1088, 0xad25833355379888ULL},
    {1089, 0x908e916ef8d86d6fULL},
    {2047, 0x5d782bcd88729d1aULL},
    {2048, 0xa509119048db8f8dULL},
    {2049, 0x827a68e78db54d28ULL},
    {4096, 0x1e05d61e1a8405e0ULL},
    {10000, 0x2608fcc7c75c5b02ULL},
    {65536, 0x5a3459bc44b45a6bULL},
    {100003, 0x89029d17e9d3f2f7ULL},
};

}  // namespace

TEST_SUITE("xxh3") {
  TEST_CASE("every branch of the algorithm gives the reference's number") {
    for (const Case& row : kCases) {
      CAPTURE(row.size);
      const std::vector<std::uint8_t> bytes = pattern(row.size);
      CHECK(xxh3Hash64({bytes.data(), bytes.size()}) == row.hash);
    }
  }

  TEST_CASE("bytes at any address") {
    const std::vector<std::uint8_t> bytes = pattern(1300);
    for (std::size_t shift = 1; shift < 9; ++shift) {
      std::vector<std::uint8_t> moved(shift + 1200);
      std::copy(bytes.begin(), bytes.begin() + 1200, moved.begin() + static_cast<std::ptrdiff_t>(shift));
      CHECK(xxh3Hash64({moved.data() + shift, 1200}) == xxh3Hash64({bytes.data(), 1200}));
    }
  }
}
