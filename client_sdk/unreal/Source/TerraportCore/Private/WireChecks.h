// What values a field may have: the same rules for what was received and for what is to be sent.
#pragma once

#include "MessageFields.generated.h"

#include <string>
#include <string_view>
#include <vector>

namespace terraport {

/// Why a value is not allowed, and where below the field (`""` for the field itself).
struct Refusal {
  std::string text;
  std::string path;
};

/// Note why; always false, so that it can be returned.
bool refuse(Refusal& refusal, std::string text, std::string path = {});

/// Put the parent's name in front of the path of a refusal; always false.
bool refusedBelow(Refusal& refusal, std::string_view parent);

/// A text for people: at most a few dozen characters of it.
std::string shortened(std::string_view text);

bool checkValue(std::uint64_t value, const IntegerKind& kind, Refusal& refusal);
bool checkValue(double value, const NumberKind& kind, Refusal& refusal);
bool checkValue(bool value, const FlagKind& kind, Refusal& refusal);
bool checkValue(const std::string& value, const TextKind& kind, Refusal& refusal);
bool checkValue(const std::string& value, const ChoiceKind& kind, Refusal& refusal);
bool checkValue(const Vec3& value, const PositionKind& kind, Refusal& refusal);
bool checkValue(const ProtocolVersion& value, const VersionKind& kind, Refusal& refusal);
bool checkValue(const std::vector<ProtocolVersion>& value, const VersionsKind& kind, Refusal& refusal);
bool checkValue(const std::vector<NamedNumber>& value, const NumbersKind& kind, Refusal& refusal);
bool checkValue(const std::vector<std::uint32_t>& value, const RowsKind& kind, Refusal& refusal);
bool checkValue(const std::vector<HeldRow>& value, const RowsKind& kind, Refusal& refusal);
bool checkValue(const std::vector<SegmentFacts>& value, const RowsKind& kind, Refusal& refusal);

// Rules between the fields of one message (wire protocol, sections 6 and 13); most have none.
template <typename Message>
bool checkRules(const Message&, Refusal&) {
  return true;
}
bool checkRules(const AimMessage& aim, Refusal& refusal);
bool checkRules(const LandMessage& land, Refusal& refusal);
bool checkRules(const GatherMessage& gather, Refusal& refusal);
bool checkRules(const PlanMessage& plan, Refusal& refusal);
bool checkRules(const PrefetchMessage& prefetch, Refusal& refusal);

}  // namespace terraport
