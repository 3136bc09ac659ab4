#pragma once

#include <string>

namespace terraport::tools {

/// Run tests/conformance/wire: good messages and frames must decode to what their .json says, and canonical ones encode to the
/// very bytes; bad ones must be refused with the error that it names. Returns the exit code.
int runWireCorpus(const std::string& folder);

/// Run tests/conformance/scene/payload: good payloads value for value against what the Python decoder found; bad ones must be
/// refused. Returns the exit code.
int runPayloadCorpus(const std::string& folder);

/// Run tests/conformance/session: each step of a history must do what the Python client did. Returns the exit code.
int runSessionCorpus(const std::string& folder);

}  // namespace terraport::tools
