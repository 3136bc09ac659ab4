// terraport-axes PAYLOAD ...
//
// Prints payloads as Unreal is given them, turned by the engine layer's own TerraportAxes.h: one JSON array of meshes.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "Terraport/DecodeQueue.h"
#include "Terraport/SegmentMesh.h"
#include "TerraportAxes.h"
#include "files.h"
#include "json_text.h"
#include "mesh_arrays.h"

namespace {

std::string base64(const std::vector<std::uint8_t>& bytes) {
  static const char* const kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t at = 0; at < bytes.size(); at += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - at);
    std::uint32_t word = 0;
    for (std::size_t byte = 0; byte < 3; ++byte) {
      word = word << 8 | (byte < count ? bytes[at + byte] : 0U);
    }
    for (std::size_t digit = 0; digit < 4; ++digit) {
      text += digit <= count ? kDigits[word >> (18 - 6 * digit) & 63U] : '=';
    }
  }
  return text;
}

void describe(terraport::tools::JsonText& json, const terraport::SegmentMesh& mesh, const terraport::SharedPayload& payload) {
  using namespace terraport;
  // 1. Geometry through TerraportAxes.h, as the mesh builder calls it.
  const tools::MeshArrays plain(mesh, viewOf(*payload));
  const std::size_t count = mesh.vertexCount;
  std::vector<float> positions(3 * count);
  if (mesh.positionForm == VertexForm::Codes) {
    const float translation[3] = {static_cast<float>(mesh.translation[0]), static_cast<float>(mesh.translation[1]),
        static_cast<float>(mesh.translation[2])};
    TerraportAxes::PositionsToUnreal(
        mesh.positionCodes.data(), count, translation, static_cast<float>(mesh.stepM), positions.data());
  } else {
    TerraportAxes::PositionsToUnreal(mesh.positions.data(), count, positions.data());
  }
  std::vector<float> normals(3 * count);
  TerraportAxes::NormalsToUnreal(mesh.normalCodes.data(), count, normals.data());
  std::vector<std::uint32_t> indices(3 * std::size_t{mesh.faceCount});
  TerraportAxes::IndicesToUnreal(mesh.indices.data(), indices.size(), indices.data());
  // 2. All of it as JSON.
  json.open('{').key("positions").numbers(positions).key("normals").numbers(normals).key("indices").integers(indices);
  json.key("uvs");
  if (mesh.hasUvs) {
    std::vector<float> uvs = plain.uvs;
    if (!mesh.uvsNormalised) {
      TerraportAxes::UvsToUnreal(mesh.uvCodes.data(), count, mesh.uvScale, uvs.data());
    }
    json.numbers(uvs);
  } else {
    json.null();
  }
  // Linear light, as the vertex colours of both engines are.
  json.key("linear_colours");
  if (plain.hasColours) {
    std::vector<float> linear;
    for (const std::uint8_t level : plain.colours) {
      const double share = level / 255.0;
      linear.push_back(static_cast<float>(share <= 0.04045 ? share / 12.92 : std::pow((share + 0.055) / 1.055, 2.4)));
    }
    json.numbers(linear);
  } else {
    json.null();
  }
  json.key("image").text(base64(plain.image)).close('}');
}

}  // namespace

int main(int count, char** arguments) {
  using namespace terraport;
  tools::JsonText json;
  json.open('[');
  for (int at = 1; at < count; ++at) {
    DecodeJob job;
    job.payload = std::make_shared<const std::vector<std::uint8_t>>(tools::readFile(arguments[at]));
    SegmentMesh mesh;
    const Status status = decodePayload(job, mesh);
    if (!status.isOk()) {
      std::fprintf(stderr, "error: %s: %s\n", arguments[at], status.text().c_str());
      return 1;
    }
    describe(json, mesh, job.payload);
  }
  std::printf("%s\n", json.close(']').str().c_str());
  return count > 1 ? 0 : 2;
}
