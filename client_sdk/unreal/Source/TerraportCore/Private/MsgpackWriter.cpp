#include "Bytes.h"
#include "Msgpack.h"

#include <cstring>

namespace terraport {

void MsgpackWriter::text(std::string_view value) {
  head(value.size(), 0xA0, 31, 0xD9, 0xDA);
  into_.append(value);
}

void MsgpackWriter::integer(std::uint64_t value) {
  if (value <= 0x7F) {
    into_.push_back(static_cast<char>(value));
    return;
  }
  const unsigned size = value <= 0xFF ? 0 : value <= 0xFFFF ? 1 : value <= 0xFFFFFFFF ? 2 : 3;
  into_.push_back(static_cast<char>(0xCC + size));
  appendBe(value, 1u << size, into_);
}

void MsgpackWriter::real(double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  into_.push_back(static_cast<char>(0xCB));
  appendBe(bits, 8, into_);
}

void MsgpackWriter::head(std::size_t count, unsigned shortToken, std::size_t shortMost, unsigned token8, unsigned token16) {
  if (shortToken != 0 && count <= shortMost) {
    into_.push_back(static_cast<char>(shortToken | count));
  } else if (token8 != 0 && count <= 0xFF) {
    into_.push_back(static_cast<char>(token8));
    appendBe(count, 1, into_);
  } else if (count <= 0xFFFF) {
    into_.push_back(static_cast<char>(token16));
    appendBe(count, 2, into_);
  } else {
    into_.push_back(static_cast<char>(token16 + 1));
    appendBe(count, 4, into_);
  }
}

}  // namespace terraport
