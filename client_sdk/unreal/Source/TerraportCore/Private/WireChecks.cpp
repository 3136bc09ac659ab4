#include "WireChecks.h"

#include "Utf8.h"

#include <algorithm>
#include <cmath>

namespace terraport {

namespace {

constexpr std::size_t kShown = 48;
constexpr std::uint32_t kMaxVersionNumber = 65535;
constexpr TextKind kNumberName{1, 128, TextPattern::Any};

bool isLetterOrDigit(char letter) {
  return (letter >= '0' && letter <= '9') || (letter >= 'a' && letter <= 'z') || (letter >= 'A' && letter <= 'Z');
}

bool isOf(TextPattern pattern, std::string_view text) {
  if (pattern == TextPattern::Any) return true;
  if (text.empty()) return false;
  if (pattern == TextPattern::GroupName) {
    return std::all_of(text.begin(), text.end(),
        [](char letter) { return isLetterOrDigit(letter) || std::string_view("_.~-").find(letter) != std::string_view::npos; });
  }
  const auto isLower = [](char letter) { return letter >= 'a' && letter <= 'z'; };
  return isLower(text.front()) && std::all_of(text.begin(), text.end(), [isLower](char letter) {
    return isLower(letter) || letter == '_' || (letter >= '0' && letter <= '9');
  });
}

bool isWithin(double value, double bound) {
  return std::abs(value) <= bound;
}

bool checkCount(std::size_t count, std::size_t most, const char* noun, Refusal& refusal) {
  if (count <= most) return true;
  return refuse(refusal, "got " + std::to_string(count) + " " + noun + ", expected at most " + std::to_string(most));
}

/// Each id at most once.
bool checkIds(std::vector<std::uint32_t> ids, Refusal& refusal) {
  std::sort(ids.begin(), ids.end());
  const auto twice = std::adjacent_find(ids.begin(), ids.end());
  if (twice == ids.end()) return true;
  return refuse(refusal, "got id " + std::to_string(*twice) + " twice, expected each id once");
}

template <typename Row>
std::vector<std::uint32_t> idsOf(const std::vector<Row>& rows) {
  std::vector<std::uint32_t> ids;
  ids.reserve(rows.size());
  for (const Row& row : rows) ids.push_back(row.segment);
  return ids;
}

bool checkFacts(const SegmentFacts& row, Refusal& refusal) {
  if (row.length < 1 || row.length > limits::kMaxSegmentBytes) {
    return refuse(refusal,
        "got a length of " + std::to_string(row.length) + ", expected 1 to " + std::to_string(limits::kMaxSegmentBytes),
        "length");
  }
  const Box& box = row.bounds;
  for (const float side : {box.minX, box.minY, box.minZ, box.maxX, box.maxY, box.maxZ}) {
    // A NaN fails the comparison, an infinity too.
    if (!isWithin(static_cast<double>(side), limits::kMaxCoordinateM)) {
      return refuse(refusal, "got a coordinate that is no number of size at most 10000000", "bounds");
    }
  }
  if (box.minX > box.maxX || box.minY > box.maxY || box.minZ > box.maxZ) {
    return refuse(refusal, "got a box whose min is above its max, expected min <= max", "bounds");
  }
  return true;
}

bool checkCoarseRadius(const std::optional<double>& coarseRadiusM, double radiusM, Refusal& refusal) {
  if (!coarseRadiusM || *coarseRadiusM >= radiusM) return true;
  return refuse(refusal, "got " + std::to_string(*coarseRadiusM) + ", expected at least radius_m", "coarse_radius_m");
}

bool checkInnerRadius(const std::optional<double>& innerRadiusM, double radiusM, Refusal& refusal) {
  if (!innerRadiusM || *innerRadiusM <= radiusM) return true;
  return refuse(refusal, "got " + std::to_string(*innerRadiusM) + ", expected at most radius_m", "inner_radius_m");
}

bool checkSum(const char* field, std::uint64_t actual, std::uint64_t expected, Refusal& refusal) {
  if (actual == expected) return true;
  return refuse(
      refusal, "got " + std::to_string(actual) + ", expected the sum over the segments, " + std::to_string(expected), field);
}

bool checkAtLeast(const char* field, std::uint64_t actual, std::uint64_t least, Refusal& refusal) {
  if (actual >= least) return true;
  return refuse(refusal, "got " + std::to_string(actual) + ", expected at least " + std::to_string(least), field);
}

std::uint64_t bytesOf(const std::vector<SegmentFacts>& rows) {
  std::uint64_t sum = 0;
  for (const SegmentFacts& row : rows) sum += row.length;
  return sum;
}

/// Whether two lists share an id; both are sorted here.
bool overlap(std::vector<std::uint32_t>& first, std::vector<std::uint32_t>& second) {
  std::sort(first.begin(), first.end());
  std::sort(second.begin(), second.end());
  auto a = first.begin();
  auto b = second.begin();
  while (a != first.end() && b != second.end()) {
    if (*a == *b) return true;
    (*a < *b ? a : b)++;
  }
  return false;
}

}  // namespace

bool refuse(Refusal& refusal, std::string text, std::string path) {
  refusal.text = std::move(text);
  refusal.path = std::move(path);
  return false;
}

bool refusedBelow(Refusal& refusal, std::string_view parent) {
  std::string path(parent);
  if (!refusal.path.empty()) path.append(".").append(refusal.path);
  refusal.path = std::move(path);
  return false;
}

std::string shortened(std::string_view text) {
  if (text.size() <= kShown) return "\"" + std::string(text) + "\"";
  return "\"" + std::string(text.substr(0, kShown)) + "\"... (" + std::to_string(text.size()) + " bytes)";
}

bool checkValue(std::uint64_t value, const IntegerKind& kind, Refusal& refusal) {
  if (value >= kind.low && value <= kind.high) return true;
  return refuse(refusal,
      "got " + std::to_string(value) + ", expected an integer from " + std::to_string(kind.low) + " to " +
          std::to_string(kind.high));
}

bool checkValue(double value, const NumberKind& kind, Refusal& refusal) {
  const bool isAbove = kind.lowExcluded ? value > kind.low : value >= kind.low;
  if (isAbove && value <= kind.high && std::isfinite(value)) return true;
  return refuse(refusal,
      "got " + std::to_string(value) + ", expected a number " + (kind.lowExcluded ? "above " : "from ") +
          std::to_string(kind.low) + " to " + std::to_string(kind.high));
}

bool checkValue(bool, const FlagKind&, Refusal&) {
  return true;
}

bool checkValue(const std::string& value, const TextKind& kind, Refusal& refusal) {
  const std::size_t length = codePointCount(value);
  if (length < kind.shortest || length > kind.longest) {
    return refuse(refusal,
        "got " + shortened(value) + ", expected text of " + std::to_string(kind.shortest) + " to " +
            std::to_string(kind.longest) + " characters");
  }
  if (!isUtf8(value)) return refuse(refusal, "got text with a lone surrogate, expected Unicode text");
  if (!isOf(kind.pattern, value)) {
    return refuse(refusal, "got " + shortened(value) + ", expected text of other characters");
  }
  return true;
}

bool checkValue(const std::string& value, const ChoiceKind& kind, Refusal& refusal) {
  std::string expected;
  for (std::size_t number = 0; number < kind.count; ++number) {
    if (value == kind.options[number]) return true;
    expected.append(number == 0 ? "" : ", ").append(kind.options[number]);
  }
  return refuse(refusal, "got " + shortened(value) + ", expected one of " + expected);
}

bool checkValue(const Vec3& value, const PositionKind& kind, Refusal& refusal) {
  if (!isWithin(value.x, kind.bound) || !isWithin(value.y, kind.bound) || !isWithin(value.z, kind.bound)) {
    return refuse(refusal,
        "got (" + std::to_string(value.x) + ", " + std::to_string(value.y) + ", " + std::to_string(value.z) +
            "), expected three finite numbers of size at most " + std::to_string(kind.bound));
  }
  if (kind.nonzero && value.x == 0 && value.y == 0 && value.z == 0) {
    return refuse(refusal, "got (0, 0, 0), expected a direction");
  }
  return true;
}

bool checkValue(const ProtocolVersion& value, const VersionKind&, Refusal& refusal) {
  if (value.majorNumber <= kMaxVersionNumber && value.minorNumber <= kMaxVersionNumber) return true;
  return refuse(refusal, "got a version beyond 65535");
}

bool checkValue(const std::vector<ProtocolVersion>& value, const VersionsKind& kind, Refusal& refusal) {
  if (!checkCount(value.size(), kind.most, "versions", refusal)) return false;
  return std::all_of(value.begin(), value.end(),
      [&refusal](const ProtocolVersion& version) { return checkValue(version, VersionKind{}, refusal); });
}

bool checkValue(const std::vector<NamedNumber>& value, const NumbersKind& kind, Refusal& refusal) {
  if (!checkCount(value.size(), kind.most, "numbers", refusal)) return false;
  for (const NamedNumber& number : value) {
    if (!checkValue(number.name, kNumberName, refusal)) return false;
    if (!std::isfinite(number.value)) {
      return refuse(refusal, "got " + std::to_string(number.value) + ", expected a finite number", number.name);
    }
  }
  return true;
}

bool checkValue(const std::vector<std::uint32_t>& value, const RowsKind& kind, Refusal& refusal) {
  return checkCount(value.size(), kind.most, "rows", refusal) && checkIds(value, refusal);
}

bool checkValue(const std::vector<HeldRow>& value, const RowsKind& kind, Refusal& refusal) {
  return checkCount(value.size(), kind.most, "rows", refusal) && checkIds(idsOf(value), refusal);
}

bool checkValue(const std::vector<SegmentFacts>& value, const RowsKind& kind, Refusal& refusal) {
  if (!checkCount(value.size(), kind.most, "rows", refusal) || !checkIds(idsOf(value), refusal)) return false;
  return std::all_of(value.begin(), value.end(), [&refusal](const SegmentFacts& row) { return checkFacts(row, refusal); });
}

bool checkRules(const AimMessage& aim, Refusal& refusal) {
  return checkCoarseRadius(aim.coarseRadiusM, aim.radiusM, refusal);
}

bool checkRules(const LandMessage& land, Refusal& refusal) {
  if (!checkCoarseRadius(land.coarseRadiusM, land.radiusM, refusal)) return false;
  if (!land.innerRadiusM) {
    const char* field = land.deadlineMs ? "deadline_ms" : land.stallMs ? "stall_ms" : nullptr;
    if (field != nullptr) return refuse(refusal, "got a deadline without inner_radius_m, expected both", field);
  }
  return checkInnerRadius(land.innerRadiusM, land.radiusM, refusal);
}

bool checkRules(const GatherMessage& gather, Refusal& refusal) {
  return checkInnerRadius(gather.innerRadiusM, gather.radiusM, refusal);
}

bool checkRules(const PlanMessage& plan, Refusal& refusal) {
  std::uint64_t triangles = 0;
  for (const SegmentFacts& row : plan.load) triangles += row.faces;
  if (!checkSum("load_bytes", plan.loadBytes, bytesOf(plan.load), refusal) ||
      !checkSum("load_triangles", plan.loadTriangles, triangles, refusal) ||
      !checkAtLeast("total_bytes", plan.totalBytes, plan.loadBytes, refusal) ||
      !checkAtLeast("total_triangles", plan.totalTriangles, plan.loadTriangles, refusal)) {
    return false;
  }
  if (plan.omittedBy.has_value() != (plan.omittedSegments != 0)) {
    return refuse(refusal, "got one of omitted_by and omitted_segments, expected both", "omitted_by");
  }
  std::vector<std::uint32_t> load = idsOf(plan.load);
  std::vector<std::uint32_t> keep = plan.keep;
  std::vector<std::uint32_t> nearby = plan.nearby;
  const char* text = "got an id that stands in another list too, expected load, keep and nearby to be disjoint";
  if (overlap(load, keep)) return refuse(refusal, text, "load");
  if (overlap(nearby, keep) || overlap(nearby, load)) return refuse(refusal, text, "nearby");
  return true;
}

bool checkRules(const PrefetchMessage& prefetch, Refusal& refusal) {
  return checkSum("bytes", prefetch.bytes, bytesOf(prefetch.segments), refusal);
}

}  // namespace terraport
