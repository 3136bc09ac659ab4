#include "Godot.h"

#include <cstring>

namespace terraport::godot {

namespace {

const abi::CoreTable* gCore = nullptr;

template <typename Signature>
Signature* at(abi::Slot slot) {
  return reinterpret_cast<Signature*>(gCore->functions[slot]);
}

std::vector<Method*>& methods() {
  static std::vector<Method*> all;
  return all;
}

/// A text of the engine's, for as long as it is needed.
class Text {
 public:
  explicit Text(const std::string& utf8) {
    at<void(abi::Text*)>(abi::kStringNew)(&raw_);
    at<bool(abi::Text*, const char*, int)>(abi::kStringParseUtf8)(&raw_, utf8.data(), static_cast<int>(utf8.size()));
  }
  ~Text() { at<void(abi::Text*)>(abi::kStringDestroy)(&raw_); }
  Text(const Text&) = delete;
  Text& operator=(const Text&) = delete;
  const abi::Text* raw() const { return &raw_; }

 private:
  abi::Text raw_;
};

}  // namespace

bool begin(const abi::CoreTable& core, std::string& missing) {
  gCore = &core;
  for (Method* method : methods()) {
    if (!method->lookUp()) {
      missing = std::string(method->className()) + "." + method->name();
      return false;
    }
  }
  return true;
}

void printError(const std::string& text) {
  at<void(const char*, const char*, const char*, int)>(abi::kPrintError)(text.c_str(), "terraport", "", 0);
}

Variant::Variant() {
  at<void(abi::Variant*)>(abi::kVariantNil)(&raw_);
}
Variant::Variant(bool value) {
  at<void(abi::Variant*, bool)>(abi::kVariantFromBool)(&raw_, value);
}
Variant::Variant(std::int64_t value) {
  at<void(abi::Variant*, std::int64_t)>(abi::kVariantFromInt)(&raw_, value);
}
Variant::Variant(double value) {
  at<void(abi::Variant*, double)>(abi::kVariantFromReal)(&raw_, value);
}
Variant::Variant(const std::string& utf8) {
  const Text text(utf8);
  at<void(abi::Variant*, const abi::Text*)>(abi::kVariantFromString)(&raw_, text.raw());
}
Variant::Variant(const Vec3& vector) {
  const float parts[3] = {static_cast<float>(vector.x), static_cast<float>(vector.y), static_cast<float>(vector.z)};
  abi::Vector3 raw;
  std::memcpy(raw.bytes, parts, sizeof(parts));
  at<void(abi::Variant*, const abi::Vector3*)>(abi::kVariantFromVector3)(&raw_, &raw);
}
Variant Variant::of(abi::Object* object) {
  abi::Variant raw;
  at<void(abi::Variant*, const abi::Object*)>(abi::kVariantFromObject)(&raw, object);
  return Variant(raw);
}
Variant::Variant(const Variant& other) {
  at<void(abi::Variant*, const abi::Variant*)>(abi::kVariantCopy)(&raw_, &other.raw_);
}
Variant::Variant(Variant&& other) noexcept : Variant() {
  std::swap(raw_, other.raw_);
}
Variant::~Variant() {
  at<void(abi::Variant*)>(abi::kVariantDestroy)(&raw_);
}

abi::Variant Variant::release() {
  Variant handed(std::move(*this));
  const abi::Variant raw = handed.raw_;
  at<void(abi::Variant*)>(abi::kVariantNil)(&handed.raw_);
  return raw;
}

bool Variant::isNil() const {
  return at<int(const abi::Variant*)>(abi::kVariantType)(&raw_) == 0;
}
bool Variant::toBool() const {
  return at<bool(const abi::Variant*)>(abi::kVariantToBool)(&raw_);
}
std::int64_t Variant::toInt() const {
  return at<std::int64_t(const abi::Variant*)>(abi::kVariantToInt)(&raw_);
}
double Variant::toReal() const {
  return at<double(const abi::Variant*)>(abi::kVariantToReal)(&raw_);
}
std::string Variant::toText() const {
  abi::Text text = at<abi::Text(const abi::Variant*)>(abi::kVariantToString)(&raw_);
  abi::Utf8 utf8 = at<abi::Utf8(const abi::Text*)>(abi::kStringToUtf8)(&text);
  const char* data = at<const char*(const abi::Utf8*)>(abi::kUtf8Data)(&utf8);
  std::string result(data != nullptr ? data : "", static_cast<std::size_t>(at<int(const abi::Utf8*)>(abi::kUtf8Length)(&utf8)));
  at<void(abi::Utf8*)>(abi::kUtf8Destroy)(&utf8);
  at<void(abi::Text*)>(abi::kStringDestroy)(&text);
  return result;
}
Vec3 Variant::toVec3() const {
  const abi::Vector3 raw = at<abi::Vector3(const abi::Variant*)>(abi::kVariantToVector3)(&raw_);
  float parts[3];
  std::memcpy(parts, raw.bytes, sizeof(parts));
  return {parts[0], parts[1], parts[2]};
}
abi::Object* Variant::toObject() const {
  return at<abi::Object*(const abi::Variant*)>(abi::kVariantToObject)(&raw_);
}
std::vector<std::uint8_t> Variant::toBytes() const {
  abi::PoolArray bytes = at<abi::PoolArray(const abi::Variant*)>(abi::kVariantToByteArray)(&raw_);
  const std::size_t size = static_cast<std::size_t>(at<int(const abi::PoolArray*)>(abi::kByteArraySize)(&bytes));
  std::vector<std::uint8_t> result(size);
  if (size > 0) {
    abi::PoolAccess* access = at<abi::PoolAccess*(const abi::PoolArray*)>(abi::kByteArrayRead)(&bytes);
    std::memcpy(result.data(), at<const std::uint8_t*(const abi::PoolAccess*)>(abi::kByteReadPointer)(access), size);
    at<void(abi::PoolAccess*)>(abi::kByteReadDestroy)(access);
  }
  at<void(abi::PoolArray*)>(abi::kByteArrayDestroy)(&bytes);
  return result;
}

List::List() {
  at<void(abi::Array*)>(abi::kArrayNew)(&raw_);
}
List::~List() {
  at<void(abi::Array*)>(abi::kArrayDestroy)(&raw_);
}
void List::add(const Variant& value) {
  at<void(abi::Array*, const abi::Variant*)>(abi::kArrayAppend)(&raw_, value.raw());
}
Variant List::variant() const {
  abi::Variant raw;
  at<void(abi::Variant*, const abi::Array*)>(abi::kVariantFromArray)(&raw, &raw_);
  return Variant(raw);
}

Dictionary::Dictionary() {
  at<void(abi::Dictionary*)>(abi::kDictionaryNew)(&raw_);
}
Dictionary::~Dictionary() {
  at<void(abi::Dictionary*)>(abi::kDictionaryDestroy)(&raw_);
}
Dictionary& Dictionary::set(const char* key, const Variant& value) {
  const Variant name(key);
  at<void(abi::Dictionary*, const abi::Variant*, const abi::Variant*)>(abi::kDictionarySet)(&raw_, name.raw(), value.raw());
  return *this;
}
Variant Dictionary::variant() const {
  abi::Variant raw;
  at<void(abi::Variant*, const abi::Dictionary*)>(abi::kVariantFromDictionary)(&raw, &raw_);
  return Variant(raw);
}

Variant stringArray(const std::vector<std::string>& texts) {
  abi::PoolArray raw;
  at<void(abi::PoolArray*)>(abi::kStringArrayNew)(&raw);
  for (const std::string& utf8 : texts) {
    const Text text(utf8);
    at<void(abi::PoolArray*, const abi::Text*)>(abi::kStringArrayAppend)(&raw, text.raw());
  }
  abi::Variant variant;
  at<void(abi::Variant*, const abi::PoolArray*)>(abi::kVariantFromStringArray)(&variant, &raw);
  at<void(abi::PoolArray*)>(abi::kStringArrayDestroy)(&raw);
  return Variant(variant);
}

Method::Method(const char* className, const char* name) : className_(className), name_(name) {
  methods().push_back(this);
}

bool Method::lookUp() {
  bind_ = at<abi::MethodBind*(const char*, const char*)>(abi::kMethodBind)(className_, name_);
  return bind_ != nullptr;
}

Variant Method::call(abi::Object* object, const abi::Variant** arguments, int count) const {
  if (object == nullptr) {
    printError(std::string(className_) + "." + name_ + ": there is no object");
    return Variant();
  }
  abi::CallError error{};
  const auto callBind =
      at<abi::Variant(abi::MethodBind*, abi::Object*, const abi::Variant**, int, abi::CallError*)>(abi::kMethodCall);
  Variant result(callBind(bind_, object, arguments, count, &error));
  if (error.error != 0) {
    printError(std::string(className_) + "." + name_ + ": argument " + std::to_string(error.argument + 1) +
        " of another kind or number than this engine takes");
  }
  return result;
}

abi::Object* singleton(const char* name) {
  // The engine's declaration lacks a const.
  return at<abi::Object*(char*)>(abi::kGlobalSingleton)(const_cast<char*>(name));
}

Variant make(const char* className) {
  using Constructor = abi::Object* (*)();
  const Constructor construct = at<Constructor(const char*)>(abi::kClassConstructor)(className);
  return construct != nullptr ? Variant::of(construct()) : Variant();
}

namespace detail {

PoolFilling::PoolFilling(const PoolSlots& slots, std::size_t count) : slots_(slots) {
  at<void(abi::PoolArray*)>(slots.make)(&raw_);
  if (count == 0) return;
  at<void(abi::PoolArray*, int)>(slots.resize)(&raw_, static_cast<int>(count));
  access_ = at<abi::PoolAccess*(abi::PoolArray*)>(slots.write)(&raw_);
  data_ = at<void*(const abi::PoolAccess*)>(slots.pointer)(access_);
}

PoolFilling::~PoolFilling() {
  end();
  at<void(abi::PoolArray*)>(slots_.destroy)(&raw_);
}

void PoolFilling::end() {
  if (access_ != nullptr) at<void(abi::PoolAccess*)>(slots_.endWrite)(access_);
  access_ = nullptr;
}

Variant PoolFilling::variant() {
  end();
  abi::Variant raw;
  at<void(abi::Variant*, const abi::PoolArray*)>(slots_.toVariant)(&raw, &raw_);
  return Variant(raw);
}

}  // namespace detail

}  // namespace terraport::godot
