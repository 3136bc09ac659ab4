#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "Session.h"
#include "Terraport/Json.h"
#include "Terraport/Xxh3.h"
#include "corpora.h"
#include "files.h"
#include "json_text.h"
#include "tally.h"

namespace terraport::tools {
namespace {

/// Base64 to bytes; the corpus has no other letters.
std::string decoded(std::string_view text) {
  static constexpr std::string_view kLetters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  std::uint32_t bits = 0;
  int count = 0;
  for (const char letter : text.substr(0, text.find('='))) {
    bits = (bits << 6) | static_cast<std::uint32_t>(kLetters.find(letter));
    count += 6;
    if (count >= 8) bytes += static_cast<char>(bits >> (count -= 8));
  }
  return bytes;
}

/// JSON has no word for NaN and infinity, a text has.
double number(const JsonValue& value) {
  return value.number() ? *value.number() : std::strtod(std::string(value.text().value_or("")).c_str(), nullptr);
}

std::optional<std::uint64_t> integer(const JsonValue& value) {
  return value.integer() ? std::optional<std::uint64_t>(static_cast<std::uint64_t>(*value.integer())) : std::nullopt;
}

Vec3 point(const JsonValue& list) {
  auto item = list.items().begin();
  const double x = number(*item);
  const double y = number(*++item);
  return {x, y, number(*++item)};
}

SessionOptions optionsOf(const JsonValue& stated) {
  SessionOptions options;
  options.client = "corpus";
  options.budgets.maxTriangles = integer(stated.member("max_triangles"));
  options.budgets.maxBytes = integer(stated.member("max_bytes"));
  options.budgets.maxSegments = integer(stated.member("max_segments"));
  options.creditBytes = *integer(stated.member("credit_bytes"));
  options.releaseFactor = stated.member("release_factor").number();
  options.cacheBytes = *integer(stated.member("cache_bytes"));
  return options;
}

/// Write an event as the corpus tells it; nothing of those that clients name in their own ways.
void writeRow(const StreamEvent& event, JsonText& into) {
  const auto row = [&into](const char* name) -> JsonText& { return into.open('[').text(name); };
  const auto ofLanding = [&](const char* name) -> JsonText& {
    return event.landing == kNoLanding ? row(name).null() : row(name).integer(event.landing);
  };
  const auto count = [](std::uint64_t value) { return static_cast<std::int64_t>(value); };
  std::vector<std::uint32_t> load;
  for (const SegmentFacts& facts : event.plan.load) load.push_back(facts.segment);
  const EventKind kind = event.kind;
  if (kind == EventKind::Opened) row("opened").boolean(event.changed).integer(count(event.heldCount)).close(']');
  if (kind == EventKind::Planned) {
    ofLanding("planned").integers(load).integers(event.plan.keep).integers(event.plan.nearby).close(']');
  }
  if (kind == EventKind::Arrived) ofLanding("arrived").integer(event.facts.segment).close(']');
  if (kind == EventKind::Degraded) ofLanding("degraded").integers(event.segments).close(']');
  if (kind == EventKind::Ready) ofLanding("ready").integers(event.segments).integers(event.missing).close(']');
  if (kind == EventKind::Superseded) ofLanding("superseded").integer(event.by).close(']');
  if (kind == EventKind::Prefetched)
    row("prefetched").integer(count(event.segmentCount)).integer(count(event.payloadBytes)).close(']');
  if (kind == EventKind::Picked) {
    JsonText& picked = row("picked").integer(count(event.request));
    (event.hit ? picked.integer(event.hit->segment) : picked.null()).close(']');
  }
  if (kind == EventKind::PickRefused) row("pick refused").integer(count(event.request)).text(event.code).close(']');
  if (kind == EventKind::Refused) ofLanding("refused").text(event.code).boolean(event.fatal).close(']');
  if (kind == EventKind::Notice) row("notice").text(event.noticeKind).close(']');
  if (kind == EventKind::GroupRefused) row("group refused").integer(count(event.request)).text(event.code).close(']');
  if (!event.group) return;
  const auto nameOf = [](GroupRole role) { return role == GroupRole::Guide ? "guide" : "member"; };
  const GroupFacts& group = *event.group;
  const GroupGathering& there = group.gathering;
  if (kind == EventKind::GroupJoined) row("joined").text(group.name).integer(group.member).text(nameOf(group.role)).close(']');
  if (kind == EventKind::GroupCalled)
    row("called").integer(there.number).integer(there.guide).boolean(!there.isOver).close(']');
  if (kind == EventKind::GroupGathered) {
    row("gathered").integer(there.number).integers(there.ready).integers(there.degraded).integers(there.missing).close(']');
  }
  if (kind != EventKind::GroupRoster) return;
  row("roster").open('[');
  for (const GroupMember& one : group.members) {
    into.open('[').integer(one.member);
    (one.name.empty() ? into.null() : into.text(one.name)).text(nameOf(one.role)).boolean(one.isPresent);
    if (one.position) {
      // Whole numbers are written alike in every language.
      into.open('[');
      for (const double side : {one.position->x, one.position->y, one.position->z}) {
        into.integer(static_cast<std::int64_t>(std::floor(1000.0 * side + 0.5)));
      }
      into.close(']');
    } else {
      into.null();
    }
    into.close(']');
  }
  into.close(']').close(']');
}

/// Do one step; messages that are taken to be sent go to `sent`.
Status perform(ClientSession& session, const std::vector<JsonValue>& given, const std::vector<std::string>& messages,
    std::vector<EncodedMessage>& sent) {
  const std::string_view name = *given[0].text();
  const auto view = [](std::string_view text) {
    return ByteSpan{reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
  };
  if (name == "take") sent = session.takeMessages();
  if (name == "receive") return session.receive(view(messages[*integer(given[1])]), false);
  if (name == "text") return session.receive(view(*given[1].text()), true);
  if (name == "connected") session.connected(*given[1].boolean());
  if (name == "lost") session.connectionLost();
  if (name == "land") {
    LandOptions options;
    if (!given[3].isNothing()) options.innerRadiusM = number(given[3]);
    if (!given[4].isNothing()) options.deadlineMs = static_cast<std::uint32_t>(*integer(given[4]));
    if (given.size() > 5) options.coarseRadiusM = number(given[5]);
    TERRAPORT_RETURN_IF_ERROR(checkLand(point(given[1]), number(given[2]), options));
    session.land(point(given[1]), number(given[2]), options);
  }
  if (name == "aim") {
    const auto ring = given.size() > 3 ? std::optional<double>(number(given[3])) : std::nullopt;
    TERRAPORT_RETURN_IF_ERROR(checkAim(point(given[1]), number(given[2]), ring));
    session.aim(point(given[1]), number(given[2]), ring);
  }
  if (name == "flush") session.flushAim();
  if (name == "pick") {
    const std::optional<Vec3> direction = given[2].isNothing() ? std::nullopt : std::optional<Vec3>(point(given[2]));
    TERRAPORT_RETURN_IF_ERROR(checkPick(point(given[1]), direction));
    session.pick(point(given[1]), direction);
  }
  if (name == "bye") session.bye();
  const auto word = [&given](std::size_t at) { return std::string(given[at].text().value_or("")); };
  if (name == "join") {
    const GroupRole role = word(2) == "guide" ? GroupRole::Guide : GroupRole::Member;
    TERRAPORT_RETURN_IF_ERROR(checkJoin(word(1), role, word(3)));
    session.join(word(1), role, word(3));
  }
  if (name == "leave") session.leave();
  if (name == "gather") {
    const auto inner = given[3].isNothing() ? std::nullopt : std::optional<double>(number(given[3]));
    const auto deadline = given[4].isNothing() ? std::nullopt : std::optional<std::uint32_t>(*integer(given[4]));
    TERRAPORT_RETURN_IF_ERROR(checkGather(point(given[1]), number(given[2]), inner, deadline));
    session.gather(point(given[1]), number(given[2]), inner, deadline);
  }
  if (name == "arrived") {
    const GroupArrival how = word(2) == "ready" ? GroupArrival::Ready
        : word(2) == "degraded"                 ? GroupArrival::Degraded
                                                : GroupArrival::Declined;
    return session.arrive(static_cast<std::uint32_t>(*integer(given[1])), how);
  }
  return Status::ok();
}

/// One history's client, and what it showed and held after the step before.
struct Run {
  ClientSession session;
  std::vector<std::uint32_t> visible, held;
  std::int64_t unfinished = kNoLanding;
  std::vector<std::uint32_t> aims{0, 0, 0, 0};

  /// Do one step; what came of it, as the corpus writes it.
  std::string told(const JsonValue& command, const std::vector<std::string>& messages) {
    std::vector<JsonValue> given;
    for (const JsonValue value : command.items()) given.push_back(value);
    std::vector<EncodedMessage> sent;
    const Status status = perform(session, given, messages, sent);
    JsonText told;
    told.open('{');
    if (!sent.empty()) told.key("out").open('[');
    for (const EncodedMessage& message : sent) {
      told.integer(std::find(messages.begin(), messages.end(), message.bytes) - messages.begin());
    }
    if (!sent.empty()) told.close(']');
    if (!status.isOk()) told.key(status.code() == "malformed" ? "violation" : "refused").boolean(true);
    JsonText withEvents = told;
    const std::size_t size = withEvents.key("events").open('[').str().size();
    for (const SessionEvent& event : session.takeEvents()) {
      if (event.news == SessionNews::Stream) writeRow(event.stream, withEvents);
    }
    if (withEvents.str().size() > size) told = withEvents.close(']');
    std::vector<std::uint32_t> heldNow;
    // The corpus' scenes have 36 segments at up to two levels.
    for (std::uint32_t id = 0; id < 72; ++id) {
      if (session.holdings().has(id)) heldNow.push_back(id);
    }
    const std::vector<std::uint32_t>& shown = session.transfers().visible();
    if (shown != std::exchange(visible, shown)) told.key("visible").integers(shown);
    if (heldNow != std::exchange(held, heldNow)) told.key("held").integers(heldNow);
    const std::int64_t newest = session.unfinished();
    if (newest != std::exchange(unfinished, newest)) {
      newest == kNoLanding ? told.key("unfinished").null() : told.key("unfinished").integer(newest);
    }
    const AimCounts& counts = session.transfers().aims();
    std::vector<std::uint32_t> aimsNow;
    for (const std::uint64_t value : {counts.landings, counts.hits, counts.prefetchedBytes, counts.usedBytes}) {
      aimsNow.push_back(static_cast<std::uint32_t>(value));
    }
    if (aimsNow != std::exchange(aims, aimsNow)) told.key("aims").integers(aimsNow);
    return told.close('}').str();
  }
};

}  // namespace

int runSessionCorpus(const std::string& folder) {
  Tally tally;
  for (const std::string& file : filesOf(folder, ".jsonl")) {
    const std::vector<std::uint8_t> bytes = readFile(folder + "/" + file);
    std::istringstream lines(std::string(bytes.begin(), bytes.end()));
    std::vector<std::string> messages;
    std::unique_ptr<Run> run;
    std::string name, failure;
    for (std::string line; std::getline(lines, line);) {
      JsonDocument document;
      if (!document.read(line).isOk()) failure = "a line that cannot be read";
      const JsonValue row = document.root();
      for (const JsonValue text : row.member("messages").items()) messages.push_back(decoded(*text.text()));
      if (row.member("history").exists()) {
        if (run != nullptr) tally.add(name, failure);
        name = *row.member("history").text();
        failure.clear();
        run.reset(new Run{{optionsOf(row.member("options")), &xxh3Hash64}, {}, {}});
      }
      if (!row.member("do").exists() || !failure.empty()) continue;
      // Compared as text: the file is compact, and has its keys in this order.
      const std::string told = run->told(row.member("do"), messages);
      const std::size_t at = line.find(",\"told\":") + 8;
      const std::string expected = line.substr(at, line.size() - at - 1);
      if (told != expected) failure = line.substr(0, at) + " got " + told + ", expected " + expected;
    }
    tally.add(name, failure);
  }
  return tally.finish();
}

}  // namespace terraport::tools
