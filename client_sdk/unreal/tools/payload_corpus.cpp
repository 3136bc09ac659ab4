#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "Terraport/DecodeQueue.h"
#include "Terraport/GlbDecoder.h"
#include "Terraport/Json.h"
#include "Terraport/SegmentMesh.h"
#include "corpora.h"
#include "files.h"
#include "mesh_arrays.h"
#include "sha256.h"
#include "tally.h"

namespace terraport::tools {
namespace {

/// Of what the corpus rounds to six digits.
constexpr double kRounded = 4e-6;

void flatten(const JsonValue& value, std::vector<double>& into) {
  if (value.isList()) {
    for (const JsonValue item : value.items()) {
      flatten(item, into);
    }
  } else {
    into.push_back(value.number().value_or(std::numeric_limits<double>::quiet_NaN()));
  }
}

/// Compare with nested lists of numbers, null standing for NaN; empty where they are the same.
template <typename Values>
std::string apart(const std::string& name, bool exists, const Values& actual, const JsonValue& expected, double tolerance) {
  if (!exists || expected.isNothing()) {
    return !exists && expected.isNothing() ? "" : name + " there or not";
  }
  std::vector<double> numbers;
  flatten(expected, numbers);
  if (numbers.size() != actual.size()) {
    return name + ": " + std::to_string(actual.size()) + " numbers, expected " + std::to_string(numbers.size());
  }
  for (std::size_t at = 0; at < numbers.size(); ++at) {
    const auto value = static_cast<double>(actual[at]);
    const bool isEqual = std::isnan(numbers[at]) ? std::isnan(value) : std::abs(value - numbers[at]) <= tolerance;
    if (!isEqual) {
      return name + "[" + std::to_string(at) + "] is " + std::to_string(value) + ", expected " + std::to_string(numbers[at]);
    }
  }
  return "";
}

std::string textureDifference(const MeshArrays& actual, const JsonValue& expected) {
  if (expected.isNothing() != actual.image.empty()) {
    return "an image there or not";
  }
  if (expected.isNothing()) {
    return "";
  }
  if (actual.mediaType != expected.member("media_type").text().value_or("")) {
    return "media type " + actual.mediaType;
  }
  if (actual.width != expected.member("width").integer() || actual.height != expected.member("height").integer()) {
    return "an image of " + std::to_string(actual.width) + " x " + std::to_string(actual.height);
  }
  const std::string digest = sha256(actual.image.data(), actual.image.size());
  return digest == expected.member("sha256").text().value_or("") ? "" : "an image with the digest " + digest;
}

std::string difference(const MeshArrays& actual, const JsonValue& expected) {
  std::vector<std::string> differences = {
      apart("positions", true, actual.positions, expected.member("positions"), 0.0),
      apart("faces", true, actual.indices, expected.member("faces"), 0.0),
      apart("normals", true, actual.normals, expected.member("normals"), kRounded),
      apart("colours", actual.hasColours, actual.colours, expected.member("colours"), 0.0),
      apart("region_ids", actual.hasRegionIds, actual.regionIds, expected.member("region_ids"), 0.0),
      apart("uvs", actual.hasUvs, actual.uvs, expected.member("uvs"), kRounded),
      textureDifference(actual, expected.member("texture")),
  };
  if (expected.member("attributes").size() != actual.attributes.size()) {
    differences.push_back(std::to_string(actual.attributes.size()) + " attributes");
  }
  for (const auto& [name, values] : actual.attributes) {
    differences.push_back(apart("attribute " + name, true, values, expected.member("attributes").member(name), 0.0));
  }
  for (const std::string& text : differences) {
    if (!text.empty()) {
      return text;
    }
  }
  return "";
}

/// What is wrong with a case; empty where it is as it should be.
std::string whyNot(const std::string& folder, const std::string& name, SegmentMesh& mesh) {
  const std::vector<std::uint8_t> text = readFile(folder + "/" + name + ".json");
  JsonDocument document;
  const std::string_view view(reinterpret_cast<const char*>(text.data()), text.size());
  if (!document.read(view).isOk()) {
    return "its .json cannot be read";
  }
  const JsonValue expected = document.root();
  const bool isGood = expected.member("good").boolean().value_or(false);
  DecodeJob job;
  job.payload = std::make_shared<const std::vector<std::uint8_t>>(readFile(folder + "/" + name));
  job.files = filesWith(expected.member("scales"));
  static GlbDecoder glb;
  const Status status = endsWith(name, ".glb") ? glb.decode(viewOf(*job.payload), mesh) : decodePayload(job, mesh);
  if (!status.isOk()) {
    return isGood ? "refused: " + status.text() : "";
  }
  if (!isGood) {
    return "was taken; expected: " + std::string(expected.member("error").text().value_or(""));
  }
  return difference(MeshArrays(mesh, viewOf(*job.payload)), expected);
}

}  // namespace

int runPayloadCorpus(const std::string& folder) {
  Tally tally;
  SegmentMesh mesh;  // one for all cases: buffers that an earlier payload filled must not show through
  for (const std::string& name : filesOf(folder, ".json", true)) {
    tally.add(name, whyNot(folder, name, mesh));
  }
  return tally.finish();
}

}  // namespace terraport::tools
