#include "Core/Session.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "Core/Segment.h"

namespace terraport {
namespace {

/// Deliveries of a damaged segment before its key is left out (section 4, rule 8).
constexpr int kMaxFailures = 2;

bool isPosition(const Vec3& point) {
  return std::max({std::fabs(point.x), std::fabs(point.y), std::fabs(point.z)}) <= kMaxCoordinateM;
}

bool isRadius(double radiusM) {
  return radiusM > 0.0 && radiusM <= kMaxRadiusM;
}

bool isPlace(const Place& place) {
  const double inner = place.innerRadiusM.value_or(place.radiusM), coarse = place.coarseRadiusM.value_or(place.radiusM);
  return isPosition(place.position) && isRadius(place.radiusM) && isRadius(inner) && inner <= place.radiusM &&
      isRadius(coarse) && coarse >= place.radiusM;
}

double distanceM(const Box& box, const Vec3& point) {
  const double at[3] = {point.x, point.y, point.z};
  double square = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    const double away = std::max({double{box.low[axis]} - at[axis], 0.0, at[axis] - double{box.high[axis]}});
    square += away * away;
  }
  return std::sqrt(square);
}

double diagonalM(const Box& box) {
  double square = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    const double side = double{box.high[axis]} - double{box.low[axis]};
    square += side * side;
  }
  return std::sqrt(square);
}

}  // namespace

Session::Session(SessionOptions options, std::map<Key, Box> onDisk)
    : options_(std::move(options)),
      cache_(options_.cacheBytes),
      disk_(std::move(onDisk)),
      seat_({[this](Bytes message) { outbox_.push_back(std::move(message)); },
          [this](GroupEvent event) { events_.emplace_back(std::move(event)); }, [this] { return isOpen_; },
          [this] { return takeRequest(); }}) {}

std::vector<Bytes> Session::takeMessages() {
  std::vector<Bytes> messages = std::exchange(outbox_, {});
  dueCredit_ = 0;
  if (isOpen_ && !open_.empty() && open_.back().generation == 0) {
    Landing& landing = open_.back();
    Land land = messageOf(landing.wanted, false);
    land.without.assign(landing.givenUp.begin(), landing.givenUp.end());
    std::sort(land.without.begin(), land.without.end());
    landing.generation = land.generation;
    landing.named = KeySet(land.have.begin(), land.have.end());
    messages.push_back(encode(land));
  }
  return messages;
}

// ---- connection

void Session::connected() {
  isOpen_ = false;
  isGreeting_ = true;
  generation_ = 0;
  dueCredit_ = takenBytes_ = acknowledgedBytes_ = 0;
  grantedBytes_ = options_.creditBytes;
  outbox_.assign(1, encode(Hello{options_.client, "", options_.budgets, options_.creditBytes}));
}

void Session::connectionLost() {
  isOpen_ = isGreeting_ = false;
  outbox_.clear();
  dueCredit_ = 0;
  part_.reset();
  if (!open_.empty()) endBeforeNewest(open_.back());
  for (Landing& landing : open_) askAgain(landing);
  seat_.connectionLost();
}

Status Session::receive(ByteSpan bytes) {
  if (isFrame(bytes)) {
    std::optional<Frame> frame;
    Status status = decodeFrame(bytes, frame);
    return status.isOk() && frame ? onFrame(*frame) : status;
  }
  Message message;
  Status status = decode(bytes, message);
  return status.isOk() ? onMessage(message) : status;
}

// ---- commands

std::int64_t Session::land(const Place& place) {
  if (!isPlace(place)) return -1;
  aim_.reset();
  Landing landing;
  landing.number = ++landings_;
  landing.wanted = place;
  if (!open_.empty() && open_.back().generation == 0) {
    events_.emplace_back(Superseded{open_.back().number, landing.number});
    open_.pop_back();
  }
  open_.push_back(std::move(landing));
  return landings_;
}

void Session::landAgain() {
  if (open_.empty() && complete_) open_.push_back(*complete_);
}

void Session::hurry(std::int64_t number) {
  for (Landing& landing : open_) landing.isUrgent = landing.isUrgent || landing.number == number;
  update();
}

bool Session::aim(const Place& place) {
  if (!isPlace(place)) return false;
  aim_ = place;
  return true;
}

void Session::flushAim() {
  if (!hasAim()) return;
  outbox_.push_back(encode(messageOf(*aim_, true)));
  aim_.reset();
}

std::int64_t Session::pick(const Vec3& origin, const std::optional<Vec3>& direction) {
  const bool isRay = !direction || (isPosition(*direction) && (direction->x != 0 || direction->y != 0 || direction->z != 0));
  if (!isPosition(origin) || !isRay) return -1;
  const Pick pick{takeRequest(), origin, direction};
  picks_[pick.request] = pick;
  if (isOpen_) outbox_.push_back(encode(pick));
  return pick.request;
}

void Session::bye() {
  if (isOpen_) outbox_.push_back(encodeBare("bye"));
}

bool Session::awaitsAnswer() const {
  const bool isPlanning = !open_.empty() && open_.back().generation != 0 && !open_.back().ready;
  return isGreeting_ || isPlanning || !picks_.empty();
}

// ---- answers of the caller

void Session::decoded(Key key, const Box& box, SharedBytes payload) {
  decoding_.erase(key);
  cache_.put({key, box, std::move(payload)});
  noteArrival(key);
}

void Session::damaged(Key key) {
  decoding_.erase(key);
  events_.emplace_back(SegmentRejected{key});
  update();
}

void Session::lost(Key key) {
  disk_.erase(key);
  damaged(key);
}

void Session::diskChanged(const std::optional<CachedSegment>& stored, const Keys& removed) {
  if (stored) disk_[stored->key] = stored->box;
  for (const Key key : removed) disk_.erase(key);
}

// ---- messages

Status Session::onMessage(const Message& message) {
  if (const auto* welcome = std::get_if<Welcome>(&message)) return onWelcome(*welcome);
  if (const auto* error = std::get_if<Error>(&message)) {
    onError(*error);
    return {};
  }
  if (std::holds_alternative<std::monostate>(message)) return {};
  if (!isOpen_) return Status::damaged("got another message first, expected welcome or error");
  if (const auto* plan = std::get_if<Plan>(&message)) return onPlan(*plan);
  if (const auto* ready = std::get_if<Ready>(&message)) return onReady(*ready);
  if (const auto* picked = std::get_if<Picked>(&message)) {
    if (picks_.erase(picked->request) > 0) events_.emplace_back(*picked);
  } else if (const auto* notice = std::get_if<Notice>(&message)) {
    events_.emplace_back(*notice);
  } else {
    seat_.receive(message);
  }
  return {};
}

Status Session::onWelcome(const Welcome& welcome) {
  if (isOpen_ || !isGreeting_) return Status::damaged("got a second welcome, expected one");
  isOpen_ = true;
  isGreeting_ = false;
  const bool isChanged = !version_.empty() && version_ != welcome.scene.version;
  version_ = welcome.scene.version;
  if (isChanged) {  // What is shown does not belong to this version.
    shownRows_.clear();
    shownKeys_.clear();
    shownHidden_.clear();
  }
  // Granted in halves: the service never runs dry while a grant is on its way.
  creditStep_ = std::max<std::uint64_t>(1, std::min(options_.creditBytes, welcome.limits.maxCreditBytes) / 2);
  baseFaces_ = welcome.scene.baseFaces;
  maxRadiusM_ = welcome.limits.maxRadiusM;
  events_.emplace_back(Opened{welcome.scene, welcome.limits, isChanged});
  for (const auto& [request, pick] : picks_) {
    (void)request;
    outbox_.push_back(encode(pick));
  }
  seat_.connected(welcome.limits.groups);
  return {};
}

void Session::onError(const Error& error) {
  // A request's own answer: nothing else was refused, unless the connection ends with it.
  bool isAnswer = seat_.refused(error);
  if (error.request && picks_.erase(*error.request) > 0) {
    events_.emplace_back(PickRefused{*error.request, error.code, error.message});
    isAnswer = true;
  }
  if (isAnswer && !error.isFatal) return;
  Refused refused{0, error.code, error.message, error.isFatal};
  if (!error.isFatal && error.generation) {
    const auto found = std::find_if(open_.begin(), open_.end(),
        [&error](const Landing& landing) { return landing.generation != 0 && landing.generation == *error.generation; });
    if (found != open_.end()) {
      refused.landing = found->number;
      open_.erase(found);
    }
  }
  events_.emplace_back(std::move(refused));
  update();  // An older landing goes on.
}

Status Session::onPlan(Plan plan) {
  Landing* landing = nullptr;
  Status status = landingOf(plan.generation, "plan", landing);
  if (!status.isOk() || landing == nullptr) return status;
  FaceBits hidden;
  status = inflateBits(plan.hidden, hidden);
  if (!status.isOk()) return status;
  endBeforeNewest(*landing);
  landing = &open_.front();
  landing->plan = std::move(plan);
  landing->ready.reset();
  landing->hidden = std::move(hidden);
  landing->waiting.clear();
  events_.emplace_back(Planned{landing->number, *landing->plan, landing->wanted});
  for (const SegmentRow& row : landing->plan->show) {
    if (cache_.use(row.key) != nullptr) continue;
    landing->waiting.insert(row.key);
    if (decoding_.count(row.key) == 0 && disk_.count(row.key) > 0) {
      decoding_[row.key] = nullptr;
      events_.emplace_back(RestoreNeeded{row.key, disk_[row.key]});
    }
  }
  trim();
  update();
  return {};
}

Status Session::onReady(const Ready& ready) {
  Landing* landing = nullptr;
  Status status = landingOf(ready.generation, "ready", landing);
  if (!status.isOk() || landing == nullptr || !landing->plan) return status;
  if (ready.missing) {
    status = inflateBits(ready.hidden.value_or(Bytes()), landing->hidden);
    if (!status.isOk()) return status;
    for (const Key key : *ready.missing) landing->waiting.erase(key);
  }
  landing->ready = ready;
  update();
  return {};
}

/// The landing that a message is about; null for one that is over.
Status Session::landingOf(std::uint32_t generation, const char* type, Landing*& out) {
  if (generation > generation_) {
    return Status::damaged("got " + std::string(type) + " of generation " + std::to_string(generation) + ", expected at most " +
        std::to_string(generation_));
  }
  for (Landing& landing : open_) {
    if (landing.generation != 0 && landing.generation == generation) out = &landing;
  }
  return {};
}

// ---- payload

Status Session::onFrame(const Frame& frame) {
  if (!isOpen_) return Status::damaged("got payload first, expected welcome or error");
  Status status = takeCredit(frame.data.size);
  if (!status.isOk()) return status;
  if (!open_.empty()) open_.back().payloadBytes += frame.data.size;
  if (frame.offset == 0) {
    part_ = std::make_shared<Bytes>();
    part_->reserve(frame.total);
    partKey_ = frame.key;
    partTotal_ = frame.total;
  }
  if (!part_ || frame.key != partKey_ || frame.total != partTotal_ || frame.offset != part_->size()) {
    return Status::damaged("got byte " + std::to_string(frame.offset) + " of " + hexOf(frame.key) + ", expected byte " +
        std::to_string(part_ ? part_->size() : 0) + " of " + hexOf(partKey_));
  }
  part_->insert(part_->end(), frame.data.data, frame.data.data + frame.data.size);
  if (part_->size() < frame.total) return {};
  if (cache_.find(frame.key) != nullptr || decoding_.count(frame.key) > 0) counts_.repeatedBytes += frame.total;
  SharedBytes payload = std::exchange(part_, nullptr);
  decoding_[frame.key] = payload;
  events_.emplace_back(SegmentCame{frame.key, std::move(payload)});
  return {};
}

Status Session::takeCredit(std::size_t bytes) {
  takenBytes_ += bytes;
  counts_.payloadBytes += bytes;
  if (takenBytes_ > grantedBytes_) {
    return Status::damaged(
        "got " + std::to_string(takenBytes_) + " bytes of payload, expected at most " + std::to_string(grantedBytes_));
  }
  const std::uint64_t granted = takenBytes_ - acknowledgedBytes_;
  if (granted < creditStep_) return {};
  acknowledgedBytes_ = takenBytes_;
  grantedBytes_ += granted;
  // A grant that waits to be sent is enlarged.
  if (dueCredit_ == 0) {
    creditAt_ = outbox_.size();
    outbox_.emplace_back();
  }
  dueCredit_ += granted;
  outbox_[creditAt_] = encodeCredit(dueCredit_);
  return {};
}

/// A segment is in memory now.
void Session::noteArrival(Key key) {
  for (Landing& landing : open_) {
    if (!landing.plan) landing.named.insert(key);
    landing.waiting.erase(key);
  }
  trim();
  update();
}

// ---- landings

/// Show the newest landing if it is complete; ask for segments again that failed.
void Session::update() {
  if (open_.empty() || !open_.back().plan) return;
  Landing& landing = open_.back();
  const Plan& plan = *landing.plan;
  if (landing.waiting.empty()) {
    Complete complete{landing.number, rowsOf(landing, plan.show.size()), landing.hidden, 0, landing.payloadBytes};
    // Those that were given up are left out of the plan; it may name one all the same.
    complete.missing = plan.show.size() - complete.rows.size();
    for (const Key key : landing.givenUp) {
      complete.missing +=
          std::none_of(plan.show.begin(), plan.show.end(), [key](const SegmentRow& row) { return row.key == key; }) ? 1 : 0;
    }
    Landing again;
    again.number = landing.number;
    again.wanted = landing.wanted;
    complete_ = std::move(again);
    open_.clear();
    shownRows_ = complete.rows;
    shownHidden_ = complete.hidden;
    shownKeys_.clear();
    for (const SegmentRow& row : shownRows_) shownKeys_.insert(row.key);
    events_.emplace_back(std::move(complete));
    trim();
    return;
  }
  const bool isDecoding =
      std::any_of(landing.waiting.begin(), landing.waiting.end(), [this](Key key) { return decoding_.count(key) > 0; });
  if (landing.ready && !isDecoding) {
    retry(landing);
  } else if (landing.isUrgent && plan.innerCount) {
    std::vector<SegmentRow> rows = rowsOf(landing, *plan.innerCount);
    if (std::any_of(rows.begin(), rows.end(), [&](const SegmentRow& row) { return landing.waiting.count(row.key) > 0; }))
      return;
    landing.isUrgent = false;
    InnerComplete inner{landing.number, std::move(rows), {}};
    if (inflateBits(plan.innerHidden.value_or(Bytes()), inner.hidden).isOk()) events_.emplace_back(std::move(inner));
  }
}

/// Send the newest landing again after failed deliveries; give it up where more failed than may be left out.
void Session::retry(Landing& landing) {
  for (const Key key : landing.waiting) {
    if (++landing.failures[key] >= kMaxFailures) landing.givenUp.insert(key);
  }
  if (landing.givenUp.size() <= kMaxWithout) return askAgain(landing);
  const std::string text = "got " + std::to_string(landing.givenUp.size()) + " damaged segments, expected at most " +
      std::to_string(kMaxWithout) + "; is something between here and the service changing payload?";
  events_.emplace_back(Refused{landing.number, "damaged", text, false});
  open_.pop_back();
}

/// Send a landing again; the segments that it has stay in memory.
void Session::askAgain(Landing& landing) {
  if (landing.plan) {
    landing.named.clear();
    for (const SegmentRow& row : landing.plan->show) landing.named.insert(row.key);
  }
  landing.generation = 0;
  landing.plan.reset();
  landing.ready.reset();
  landing.waiting.clear();
}

/// End what was asked for before that landing.
void Session::endBeforeNewest(const Landing& newest) {
  const std::int64_t number = newest.number;
  while (open_.front().number != number) {
    events_.emplace_back(Superseded{open_.front().number, number});
    open_.erase(open_.begin());
  }
}

Land Session::messageOf(const Place& place, bool isPrefetch) {
  Land land;
  land.isPrefetch = isPrefetch;
  land.generation = ++generation_;
  land.place = place;
  land.takenBytes = takenBytes_;
  if (place.coarseRadiusM) {  // Less coarse ground is better than no landing.
    land.place.coarseRadiusM = std::max(place.radiusM, std::min(*place.coarseRadiusM, maxRadiusM_));
  }
  // The service goes by the box of the finer level: a coarser one differs by a little.
  const double radiusM = land.place.coarseRadiusM.value_or(place.radiusM);
  std::vector<std::pair<double, Key>> near;
  const auto add = [&](Key key, const Box& box) {
    const double away = distanceM(box, place.position);
    if (away <= radiusM + diagonalM(box)) near.emplace_back(away, key);
  };
  for (const CachedSegment& entry : cache_.entries()) add(entry.key, entry.box);
  for (const auto& [key, box] : disk_) {
    if (cache_.find(key) == nullptr) add(key, box);
  }
  // What came and is not decoded yet has no box: it was asked for a moment ago, so it is near.
  for (const auto& [key, payload] : decoding_) {
    if (payload && cache_.find(key) == nullptr && disk_.count(key) == 0) near.emplace_back(0.0, key);
  }
  std::sort(near.begin(), near.end());
  near.resize(std::min(near.size(), kMaxHave));
  for (const auto& [away, key] : near) {
    (void)away;
    land.have.push_back(key);
  }
  return land;
}

/// The first rows of a plan, without those that are missing.
std::vector<SegmentRow> Session::rowsOf(const Landing& landing, std::size_t count) const {
  std::vector<SegmentRow> rows(landing.plan->show.begin(), landing.plan->show.begin() + static_cast<std::ptrdiff_t>(count));
  if (landing.ready && landing.ready->missing) {
    const KeySet missing(landing.ready->missing->begin(), landing.ready->missing->end());
    const auto isMissing = [&missing](const SegmentRow& row) { return missing.count(row.key) > 0; };
    rows.erase(std::remove_if(rows.begin(), rows.end(), isMissing), rows.end());
  }
  return rows;
}

void Session::trim() {
  if (!cache_.isFull()) return;
  KeySet needed = shownKeys_;
  for (const Landing& landing : open_) {
    if (!landing.plan) needed.insert(landing.named.begin(), landing.named.end());
    if (landing.plan) {
      for (const SegmentRow& row : landing.plan->show) needed.insert(row.key);
    }
  }
  cache_.trim([&needed](Key key) { return needed.count(key) > 0; });
}

Status Session::inflateBits(const Bytes& packed, FaceBits& out) const {
  const std::size_t size = (std::size_t{baseFaces_} + 7) / 8;
  if (Inflater().inflateGzip(packed, size, out)) return {};
  return Status::damaged("got hidden faces that are damaged, expected a gzip stream of " + std::to_string(size) + " bytes");
}

}  // namespace terraport
