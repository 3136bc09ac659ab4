// The head of a segment on disk, before its payload: magic, row of the load table, hash of the row. As the Python SDK's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "Terraport/Types.h"

namespace terraport {

constexpr std::size_t kSegmentHeadBytes = 64;

std::vector<std::uint8_t> segmentHead(const SegmentFacts& facts);

/// What a head says; nothing where it is none, or not of a file of this length. `head` has kSegmentHeadBytes.
std::optional<SegmentFacts> readSegmentHead(const std::uint8_t* head, std::uint64_t fileBytes);

/// Name of a segment's file.
std::string segmentFileName(std::uint32_t segment, std::uint64_t xxh3);

/// Segment of a file's name; nothing where it is no segment's.
std::optional<std::uint32_t> segmentOfFileName(const std::string& name);

/// 16 hexadecimal digits.
std::string hexOf(std::uint64_t number);

}  // namespace terraport
