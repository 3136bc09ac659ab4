#include "Core/Ktx2.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <string>
#include <utility>

#include "Core/BasisBits.h"

namespace terraport {
namespace {

constexpr std::uint32_t kMaxSide = 4096;
constexpr std::size_t kKtxHeaderBytes = 80;
constexpr std::size_t kKtxLevelBytes = 24;
constexpr std::size_t kGlobalBytes = 20;
constexpr std::size_t kImageBytes = 20;
constexpr std::uint8_t kEtc1s = 163;

/// Brightness of the four selectors about a block's colour (ETC1's table of modifiers).
constexpr int kModifiers[8][4] = {{-8, -2, 2, 8}, {-17, -5, 5, 17}, {-29, -9, 9, 29}, {-42, -13, 13, 42}, {-60, -18, 18, 60},
    {-80, -24, 24, 80}, {-106, -33, 33, 106}, {-183, -47, 47, 183}};

struct Endpoint {
  /// Five bits each.
  std::uint8_t colour[3] = {0, 0, 0};
  std::uint8_t table = 0;
};

/// Two bits a texel, rows of four.
using Selector = std::array<std::uint8_t, 16>;

/// What all levels of a file share.
struct Codebooks {
  std::vector<Endpoint> endpoints;
  std::vector<Selector> selectors;
  HuffmanTable predictions, endpointDeltas, selectorSymbols, runs;
  std::uint32_t historySize = 0;
};

Status damagedKtx(const char* what) {
  return Status::damaged(std::string("KTX2: ") + what);
}

/// A part of the file; empty where it does not lie in it.
ByteSpan partOf(ByteSpan file, std::uint64_t offset, std::uint64_t bytes) {
  return offset <= file.size && bytes <= file.size - offset ? ByteSpan{file.data + offset, static_cast<std::size_t>(bytes)}
                                                            : ByteSpan{nullptr, 0};
}

bool readEndpoints(ByteSpan bytes, std::uint32_t count, std::vector<Endpoint>& out) {
  BasisBits bits(bytes);
  HuffmanTable colours[3], tables;
  for (HuffmanTable& table : colours) {
    if (!table.read(bits)) return false;
  }
  if (!tables.read(bits)) return false;
  const bool isGrey = bits.take(1) != 0;
  Endpoint last;
  std::fill(last.colour, last.colour + 3, std::uint8_t{16});
  out.resize(count);
  for (Endpoint& endpoint : out) {
    last.table = static_cast<std::uint8_t>((last.table + tables.decode(bits)) & 7);
    for (int channel = 0; channel < (isGrey ? 1 : 3); ++channel) {
      const std::uint32_t before = last.colour[channel];
      // Three tables of differences: for dark, middle and light values before.
      const HuffmanTable& table = colours[before <= 9 ? 0 : before <= 21 ? 1 : 2];
      last.colour[channel] = static_cast<std::uint8_t>((before + table.decode(bits)) & 31);
    }
    if (isGrey) last.colour[1] = last.colour[2] = last.colour[0];
    endpoint = last;
  }
  return bits.isGood();
}

bool readSelectors(ByteSpan bytes, std::uint32_t count, std::vector<Selector>& out) {
  BasisBits bits(bytes);
  // Codebooks that files share are of no file that is written today.
  if (bits.take(1) != 0 || bits.take(1) != 0) return false;
  const bool isRaw = bits.take(1) != 0;
  HuffmanTable changes;
  if (!isRaw && !changes.read(bits)) return false;
  std::uint32_t rows[4] = {0, 0, 0, 0};
  out.resize(count);
  for (std::size_t at = 0; at < out.size(); ++at) {
    for (std::size_t row = 0; row < 4; ++row) {
      rows[row] = isRaw || at == 0 ? bits.take(8) : (rows[row] ^ changes.decode(bits)) & 255;
      for (std::size_t column = 0; column < 4; ++column) {
        out[at][4 * row + column] = static_cast<std::uint8_t>((rows[row] >> (2 * column)) & 3);
      }
    }
  }
  return bits.isGood();
}

bool readTables(ByteSpan bytes, Codebooks& books) {
  BasisBits bits(bytes);
  for (HuffmanTable* table : {&books.predictions, &books.endpointDeltas, &books.selectorSymbols, &books.runs}) {
    if (!table->read(bits)) return false;
  }
  books.historySize = bits.take(13);
  return bits.isGood();
}

/// The selectors that were used last, nearly in that order.
class History {
 public:
  explicit History(std::uint32_t size) : values_(size, 0), next_(size / 2) {}
  std::size_t size() const { return values_.size(); }
  void add(std::uint32_t value) {
    if (values_.empty()) return;
    values_[next_] = value;
    next_ = next_ + 1 == values_.size() ? values_.size() / 2 : next_ + 1;
  }
  /// Taken, and moved half the way to the front.
  std::uint32_t use(std::size_t at) {
    const std::uint32_t value = values_[at];
    std::swap(values_[at], values_[at / 2]);
    return value;
  }

 private:
  std::vector<std::uint32_t> values_;
  std::size_t next_;
};

/// One level's blocks, as numbers of both codebooks, handed to `put` row by row; false where the stream is damaged.
template <typename Put>
bool readSlice(ByteSpan bytes, const Codebooks& books, std::uint32_t columns, std::uint32_t rows, Put put) {
  constexpr std::uint32_t kRepeat = 256, kLeastRepeats = 3, kLeastRun = 3, kLongRun = 63;
  const auto endpointCount = static_cast<std::uint32_t>(books.endpoints.size());
  const auto selectorCount = static_cast<std::uint32_t>(books.selectors.size());
  BasisBits bits(bytes);
  History history(books.historySize);
  // Of this row and the one above: endpoint of a block, and what the row above said of this one's predictions.
  std::vector<std::uint32_t> endpoints[2] = {std::vector<std::uint32_t>(columns), std::vector<std::uint32_t>(columns)};
  std::vector<std::uint32_t> kept(columns);
  std::uint32_t predictions = 0, lastPredictions = 0, repeats = 0, run = 0, endpoint = 0;
  for (std::uint32_t row = 0; row < rows; ++row) {
    std::vector<std::uint32_t>&here = endpoints[row & 1], &above = endpoints[(row & 1) ^ 1];
    for (std::uint32_t column = 0; column < columns; ++column) {
      // 1. How the endpoint is told: one symbol for a square of four blocks.
      if ((column & 1) == 0) {
        if ((row & 1) != 0) {
          predictions = kept[column];
        } else {
          if (repeats > 0) {
            --repeats;
            predictions = lastPredictions;
          } else {
            predictions = books.predictions.decode(bits);
            if (predictions == kRepeat) {
              repeats = bits.takeVariable(4) + kLeastRepeats - 1;
              predictions = lastPredictions;
            } else {
              lastPredictions = predictions;
            }
          }
          kept[column] = predictions >> 4;
        }
      }
      const std::uint32_t kind = predictions & 3;
      predictions >>= 2;
      // 2. The endpoint: that of the left, of above, of above left, or so much farther.
      if ((kind == 0 && column == 0) || (kind == 1 && row == 0) || (kind == 2 && (row == 0 || column == 0))) return false;
      if (kind == 1) {
        endpoint = above[column];
      } else if (kind == 2) {
        endpoint = above[column - 1];
      } else if (kind == 3) {
        endpoint += books.endpointDeltas.decode(bits);
        endpoint -= endpoint >= endpointCount ? endpointCount : 0;
      }
      here[column] = endpoint;
      // 3. The selector: a new one, one of the history, or the history's first for a while.
      std::uint32_t symbol = selectorCount;
      if (run > 0) {
        --run;
      } else {
        symbol = books.selectorSymbols.decode(bits);
        if (symbol == selectorCount + history.size()) {
          const std::uint32_t length = books.runs.decode(bits);
          run = (length == kLongRun ? bits.takeVariable(7) : length) + kLeastRun - 1;
          symbol = selectorCount;
        }
      }
      std::uint32_t selector = symbol;
      if (symbol >= selectorCount) {
        if (symbol - selectorCount >= history.size()) return false;
        selector = history.use(symbol - selectorCount);
      } else {
        history.add(selector);
      }
      if (endpoint >= endpointCount || selector >= selectorCount || !bits.isGood()) return false;
      put(books.endpoints[endpoint], books.selectors[selector]);
    }
  }
  return true;
}

void putEtc1(const Endpoint& endpoint, const Selector& selector, std::uint8_t* out) {
  for (int channel = 0; channel < 3; ++channel) out[channel] = static_cast<std::uint8_t>(endpoint.colour[channel] << 3);
  // Both halves have one table; the second colour is the first plus nothing.
  out[3] = static_cast<std::uint8_t>((endpoint.table << 5) | (endpoint.table << 2) | 2);
  // Selectors from dark to light as ETC1 numbers them, column by column, in two planes.
  constexpr std::uint32_t kCodes[4] = {3, 2, 0, 1};
  std::uint32_t high = 0, low = 0;
  for (std::uint32_t column = 0; column < 4; ++column) {
    for (std::uint32_t row = 0; row < 4; ++row) {
      const std::uint32_t code = kCodes[selector[4 * row + column]];
      high |= (code >> 1) << (4 * column + row);
      low |= (code & 1) << (4 * column + row);
    }
  }
  out[4] = static_cast<std::uint8_t>(high >> 8);
  out[5] = static_cast<std::uint8_t>(high);
  out[6] = static_cast<std::uint8_t>(low >> 8);
  out[7] = static_cast<std::uint8_t>(low);
}

struct Colour {
  int channel[3];
};

Colour colourOf(const Endpoint& endpoint, int selector) {
  Colour colour{};
  for (int channel = 0; channel < 3; ++channel) {
    const int base = (endpoint.colour[channel] << 3) | (endpoint.colour[channel] >> 2);
    colour.channel[channel] = std::clamp(base + kModifiers[endpoint.table][selector], 0, 255);
  }
  return colour;
}

std::uint16_t shortOf(const Colour& colour) {
  const auto scaled = [](int level, int most) { return (level * most + 127) / 255; };
  return static_cast<std::uint16_t>(
      (scaled(colour.channel[0], 31) << 11) | (scaled(colour.channel[1], 63) << 5) | scaled(colour.channel[2], 31));
}

Colour longOf(std::uint16_t code) {
  const int red = code >> 11, green = (code >> 5) & 63, blue = code & 31;
  return {{(red << 3) | (red >> 2), (green << 2) | (green >> 4), (blue << 3) | (blue >> 2)}};
}

void putBc1(const Endpoint& endpoint, const Selector& selector, std::uint8_t* out) {
  // 1. The darkest and the lightest colour that is used span BC1's four.
  const auto [least, most] = std::minmax_element(selector.begin(), selector.end());
  std::uint16_t first = shortOf(colourOf(endpoint, *most)), second = shortOf(colourOf(endpoint, *least));
  // The larger one first: else two of the four would mean something else.
  if (first < second) std::swap(first, second);
  // 2. Each of ETC1S's four goes to the nearest of them.
  const Colour one = longOf(first), other = longOf(second);
  std::uint32_t codes[4] = {0, 0, 0, 0};
  for (int from = *least; from <= *most && first != second; ++from) {
    const Colour wanted = colourOf(endpoint, from);
    int nearest = 0x7FFFFFFF;
    for (std::uint32_t code = 0; code < 4; ++code) {
      const int share = code == 0 ? 3 : code == 1 ? 0 : code == 2 ? 2 : 1;
      int distance = 0;
      for (int channel = 0; channel < 3; ++channel) {
        const int level = (share * one.channel[channel] + (3 - share) * other.channel[channel]) / 3;
        distance += (level - wanted.channel[channel]) * (level - wanted.channel[channel]);
      }
      if (distance < nearest) {
        nearest = distance;
        codes[from] = code;
      }
    }
  }
  // 3. Two colours, and two bits a texel, row by row.
  out[0] = static_cast<std::uint8_t>(first);
  out[1] = static_cast<std::uint8_t>(first >> 8);
  out[2] = static_cast<std::uint8_t>(second);
  out[3] = static_cast<std::uint8_t>(second >> 8);
  for (std::size_t row = 0; row < 4; ++row) {
    std::uint32_t packed = 0;
    for (std::size_t column = 0; column < 4; ++column) packed |= codes[selector[4 * row + column]] << (2 * column);
    out[4 + row] = static_cast<std::uint8_t>(packed);
  }
}

}  // namespace

Status decodeKtx2(ByteSpan file, BlockForm form, std::vector<BlockLevel>& levels) {
  levels.clear();
  // 1. Header and kind.
  static constexpr std::uint8_t kMagic[12] = {0xAB, 'K', 'T', 'X', ' ', '2', '0', 0xBB, '\r', '\n', 0x1A, '\n'};
  if (file.size < kKtxHeaderBytes || std::memcmp(file.data, kMagic, sizeof(kMagic)) != 0) {
    return damagedKtx("no header of version 2.0");
  }
  const std::uint32_t width = readU32(file.data + 20), height = readU32(file.data + 24);
  const std::uint32_t levelCount = readU32(file.data + 40), scheme = readU32(file.data + 44);
  const ByteSpan description = partOf(file, readU32(file.data + 48), readU32(file.data + 52));
  const bool isFlat = readU32(file.data + 28) == 0 && readU32(file.data + 32) <= 1 && readU32(file.data + 36) == 1;
  if (description.size < 16 || description.data[12] != kEtc1s || scheme != 1 || !isFlat) {
    return Status::failed("unsupported", "KTX2 of another kind, expected one flat image of ETC1S with BasisLZ");
  }
  if (width == 0 || height == 0 || width > kMaxSide || height > kMaxSide || levelCount == 0 || levelCount > 13) {
    return damagedKtx("sides or number of levels out of bounds");
  }
  // 2. What all levels share.
  const ByteSpan global = partOf(file, readU64(file.data + 64), readU64(file.data + 72));
  const std::size_t imagesEnd = kGlobalBytes + kImageBytes * levelCount;
  if (global.size < imagesEnd || file.size < kKtxHeaderBytes + kKtxLevelBytes * levelCount) {
    return damagedKtx("the codebooks' head is cut off");
  }
  const std::uint32_t endpointCount = readU32(global.data) & 0xFFFF, selectorCount = readU32(global.data) >> 16;
  const std::uint64_t endpointBytes = readU32(global.data + 4), selectorBytes = readU32(global.data + 8);
  const std::uint64_t tableBytes = readU32(global.data + 12);
  Codebooks books;
  if (!readEndpoints(partOf(global, imagesEnd, endpointBytes), endpointCount, books.endpoints) ||
      !readSelectors(partOf(global, imagesEnd + endpointBytes, selectorBytes), selectorCount, books.selectors) ||
      !readTables(partOf(global, imagesEnd + endpointBytes + selectorBytes, tableBytes), books)) {
    return damagedKtx("a codebook cannot be read");
  }
  // 3. Level after level; none of them where one is not as it should be.
  std::vector<BlockLevel> decoded;
  for (std::uint32_t level = 0; level < levelCount; ++level) {
    const std::uint8_t* const row = file.data + kKtxHeaderBytes + kKtxLevelBytes * level;
    const std::uint8_t* const image = global.data + kGlobalBytes + kImageBytes * level;
    const ByteSpan data = partOf(file, readU64(row), readU64(row + 8));
    if (readU32(image + 16) != 0) return Status::failed("unsupported", "KTX2 with alpha, expected an opaque image");
    BlockLevel out;
    out.width = std::max(width >> level, 1U);
    out.height = std::max(height >> level, 1U);
    const std::uint32_t columns = (out.width + 3) / 4, rows = (out.height + 3) / 4;
    out.blocks.resize(std::size_t{8} * columns * rows);
    std::uint8_t* next = out.blocks.data();
    const auto put = [&next, form](const Endpoint& endpoint, const Selector& selector) {
      form == BlockForm::Bc1 ? putBc1(endpoint, selector, next) : putEtc1(endpoint, selector, next);
      next += 8;
    };
    if (!readSlice(partOf(data, readU32(image + 4), readU32(image + 8)), books, columns, rows, put)) {
      return damagedKtx("a level cannot be read");
    }
    decoded.push_back(std::move(out));
  }
  levels = std::move(decoded);
  return {};
}

}  // namespace terraport
