#include "land_options.h"

#include <cstdio>
#include <cstdlib>
#include <fstream>

namespace terraport::tools {
namespace {

const char* const kUsage =
    "usage: terraport-land --scene URL [--NAME VALUE ...] STEP ...\n"
    "  --token T  --token-file PATH (read anew for each connection)  --max-triangles N  --max-bytes N  --max-segments N\n"
    "  --cache-bytes N  --credit-bytes N  --disk FOLDER  --disk-bytes N  --threaded 0|1  --timeout-s S  --dump FOLDER  "
    "--staged 0|1\n"
    "steps: land:X,Y,Z,RADIUS[,INNER,DEADLINE_MS]  (until ready)    start:X,Y,Z,RADIUS  (until planned)\n"
    "       wait  (until the newest landing is ready)    aim:X,Y,Z,RADIUS  (until prefetched)\n"
    "       pick:X,Y,Z[,DX,DY,DZ]    pause:MS    reconnect[:TOKEN]\n"
    "       join:NAME,guide|member[,OWN_NAME]  (until there is a seat)    people:N    leave    follow:0|1  (staged)\n"
    "       gather:X,Y,Z,RADIUS  (until told)    barrier:N  (until the barrier of the group's landing N has opened)\n"
    "       stand:X,Y,Z  (staged: the height of the ground that is shown there, and its segment)\n";

bool setOption(LandRequest& request, const std::string& name, const std::string& value) {
  StreamOptions& stream = request.stream;
  const auto whole = [&value] { return std::strtoull(value.c_str(), nullptr, 10); };
  if (name == "scene") {
    stream.sceneUrl = value;
  } else if (name == "token") {
    stream.token = value;
  } else if (name == "token-file") {
    stream.tokenProvider = [value] {
      std::string token;
      std::ifstream(value) >> token;
      return token;
    };
  } else if (name == "max-triangles") {
    stream.budgets.maxTriangles = whole();
  } else if (name == "max-bytes") {
    stream.budgets.maxBytes = whole();
  } else if (name == "max-segments") {
    stream.budgets.maxSegments = whole();
  } else if (name == "cache-bytes") {
    stream.cacheBytes = whole();
  } else if (name == "credit-bytes") {
    stream.creditBytes = whole();
  } else if (name == "disk") {
    stream.diskFolder = value;
  } else if (name == "disk-bytes") {
    stream.diskBytes = whole();
  } else if (name == "threaded") {
    request.isThreaded = value == "1";
  } else if (name == "timeout-s") {
    request.timeoutS = std::atof(value.c_str());
  } else if (name == "dump") {
    request.dumpFolder = value;
  } else if (name == "staged") {
    request.isStaged = value == "1";
  } else {
    return false;
  }
  return true;
}

Step parseStep(const std::string& text) {
  Step step;
  step.text = text;
  const std::size_t colon = text.find(':');
  step.kind = text.substr(0, colon);
  if (colon == std::string::npos) {
    return step;
  }
  step.argument = text.substr(colon + 1);
  const char* at = step.argument.c_str();
  for (char* end = nullptr; *at != '\0'; at = *end == ',' ? end + 1 : end) {
    const double number = std::strtod(at, &end);
    if (end == at) {
      break;
    }
    step.numbers.push_back(number);
  }
  return step;
}

/// How many numbers a kind of step takes, at least; -1 for a kind that there is not.
int numbersOf(const std::string& kind) {
  if (kind == "land" || kind == "start" || kind == "aim" || kind == "gather") {
    return 4;
  }
  if (kind == "pick" || kind == "stand") {
    return 3;
  }
  if (kind == "pause" || kind == "follow" || kind == "barrier" || kind == "people") {
    return 1;
  }
  return kind == "wait" || kind == "reconnect" || kind == "join" || kind == "leave" ? 0 : -1;
}

}  // namespace

std::optional<LandRequest> parseLand(int count, char** arguments) {
  LandRequest request;
  request.stream.client = "terraport-land-cpp";
  for (int at = 1; at < count; ++at) {
    const std::string text = arguments[at];
    if (text.rfind("--", 0) == 0) {
      if (at + 1 == count || !setOption(request, text.substr(2), arguments[at + 1])) {
        std::fprintf(stderr, "error: option %s\n%s", text.c_str(), kUsage);
        return std::nullopt;
      }
      ++at;
      continue;
    }
    Step step = parseStep(text);
    const int needed = numbersOf(step.kind);
    if (needed < 0 || step.numbers.size() < static_cast<std::size_t>(needed)) {
      std::fprintf(stderr, "error: step %s\n%s", text.c_str(), kUsage);
      return std::nullopt;
    }
    request.steps.push_back(std::move(step));
  }
  if (request.stream.sceneUrl.empty() || request.steps.empty()) {
    std::fputs(kUsage, stderr);
    return std::nullopt;
  }
  return request;
}

}  // namespace terraport::tools
