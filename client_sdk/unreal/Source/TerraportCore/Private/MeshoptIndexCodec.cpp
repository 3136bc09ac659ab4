// Triangles of EXT_meshopt_compression (specification, appendix A, "Mode 1: triangles").
#include "Meshopt.h"

namespace terraport {
namespace {

constexpr std::size_t kIndexTailBytes = 16;

/// The most recent vertices and edges. What was never put in is no vertex: such a face is refused by its index.
class Recent {
 public:
  Recent() {
    for (std::size_t at = 0; at < 16; ++at) {
      vertices_[at] = edges_[at][0] = edges_[at][1] = 0xFFFFFFFFU;
    }
  }

  std::uint32_t vertex(std::uint32_t back) const { return vertices_[(vertexEnd_ - 1 - back) & 15]; }
  const std::uint32_t* edge(std::uint32_t back) const { return edges_[(edgeEnd_ - 1 - back) & 15]; }

  void pushVertex(std::uint32_t vertex) {
    vertices_[vertexEnd_] = vertex;
    vertexEnd_ = (vertexEnd_ + 1) & 15;
  }

  /// Push where `isNew`, without a branch: whether it is cannot be foreseen.
  void pushVertexIf(std::uint32_t vertex, bool isNew) {
    vertices_[vertexEnd_] = vertex;
    vertexEnd_ = (vertexEnd_ + (isNew ? 1U : 0U)) & 15;
  }

  void pushEdge(std::uint32_t a, std::uint32_t b) {
    edges_[edgeEnd_][0] = a;
    edges_[edgeEnd_][1] = b;
    edgeEnd_ = (edgeEnd_ + 1) & 15;
  }

 private:
  std::uint32_t vertices_[16];
  std::uint32_t edges_[16][2];
  std::uint32_t vertexEnd_ = 0;
  std::uint32_t edgeEnd_ = 0;
};

/// Reads at most 5 bytes.
std::uint32_t readVarint(const std::uint8_t*& data) {
  const std::uint8_t first = *data++;
  if (first < 128) {
    return first;
  }
  std::uint32_t value = first & 127;
  for (std::uint32_t shift = 7; shift < 35; shift += 7) {
    const std::uint8_t byte = *data++;
    value |= std::uint32_t{byte & 127U} << shift;
    if (byte < 128) {
      break;
    }
  }
  return value;
}

std::uint32_t readIndex(const std::uint8_t*& data, std::uint32_t& last) {
  const std::uint32_t value = readVarint(data);
  last += (value >> 1) ^ (0U - (value & 1));
  return last;
}

}  // namespace

// Layout: codec byte, one code byte a face, data bytes, table of 16. Invariant at the start of each face: `code` is at the
// face's own byte, `data` at most at the table, `next` is what the next vertex in order of first use is called, and the next
// index that the data states is a difference to `last`.
bool meshoptDecodeTriangles(ByteSpan packed, std::size_t count, std::uint32_t* indices) {
  // 1. The sizes that everything below relies on.
  const std::size_t faces = count / 3;
  if (count % 3 != 0 || packed.size < 1 + kIndexTailBytes || packed.size - 1 - kIndexTailBytes < faces ||
      packed.data[0] != kMeshoptIndexCodec) {
    return false;
  }
  const std::uint8_t* code = packed.data + 1;
  const std::uint8_t* data = code + faces;
  // A face takes at most 16 bytes, as long as the table at the end: looking at the start of each face is enough.
  const std::uint8_t* table = packed.data + packed.size - kIndexTailBytes;
  Recent recent;
  std::uint32_t next = 0;
  std::uint32_t last = 0;

  // 2. Face by face.
  for (std::uint32_t* out = indices; out != indices + count; out += 3) {
    if (data > table) {
      return false;
    }
    const std::uint32_t edge = *code >> 4;
    const std::uint32_t cornerCode = *code & 15;
    ++code;
    // 2a. A face at a recent edge: one corner more.
    if (edge < 15) {
      const std::uint32_t a = recent.edge(edge)[0];
      const std::uint32_t b = recent.edge(edge)[1];
      std::uint32_t c = 0;
      if (cornerCode < 13) {
        const bool isNew = cornerCode == 0;
        const std::uint32_t cached = recent.vertex(cornerCode);
        c = isNew ? next : cached;
        next += isNew ? 1 : 0;
        recent.pushVertexIf(c, isNew);
      } else {
        c = cornerCode == 13 ? --last : (cornerCode == 14 ? ++last : readIndex(data, last));
        recent.pushVertex(c);
      }
      out[0] = a;
      out[1] = b;
      out[2] = c;
      recent.pushEdge(c, b);
      recent.pushEdge(a, c);
      continue;
    }
    // 2b. Three corners of their own: by the table, or by a byte of the data that says of each what it is.
    const bool isExplicit = cornerCode >= 14;
    const std::uint8_t kinds = isExplicit ? *data++ : table[cornerCode];
    const std::uint32_t kindB = kinds >> 4;
    const std::uint32_t kindC = kinds & 15;
    if (isExplicit && kinds == 0) {
      next = 0;
    }
    // All that is `next` is counted before anything is read from the data: the order in which an encoder numbers.
    std::uint32_t a = cornerCode == 15 ? 0 : next++;
    std::uint32_t b = kindB == 0 ? next++ : recent.vertex(kindB - 1);
    std::uint32_t c = kindC == 0 ? next++ : recent.vertex(kindC - 1);
    if (cornerCode == 15) {
      a = readIndex(data, last);
    }
    if (isExplicit && kindB == 15) {
      b = readIndex(data, last);
    }
    if (isExplicit && kindC == 15) {
      c = readIndex(data, last);
    }
    out[0] = a;
    out[1] = b;
    out[2] = c;
    recent.pushVertex(a);
    recent.pushVertexIf(b, kindB == 0 || (isExplicit && kindB == 15));
    recent.pushVertexIf(c, kindC == 0 || (isExplicit && kindC == 15));
    recent.pushEdge(b, a);
    recent.pushEdge(c, b);
    recent.pushEdge(a, c);
  }
  // 3. Used up exactly, or it was no stream of so many faces.
  return data == table;
}

}  // namespace terraport
