// What the engine loads: the class that scripts see (terraport_client.gdns), and its methods.

#include <cstring>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "Godot.h"
#include "Session.h"
#include "WebSocket.h"

namespace terraport::godot {
namespace {

/// The object behind one instance of the script's class. Settings are kept until `open`.
class Client {
 public:
  explicit Client(abi::Object* owner) : owner_(owner) {}

  abi::Object* owner() const { return owner_; }
  Session* session() const { return session_.get(); }
  void close() { session_.reset(); }

  void configure(const std::string& name, const Variant& value) { settings_[name] = value; }

  void open() {
    close();
    SessionSettings settings;
    settings.url = text("url");
    settings.token = text("token");
    settings.attribute = text("attribute");
    settings.draw.scenario = settings_["scenario"];
    settings.draw.shader = settings_["shader"];
    settings.draw.transform = settings_["transform"];
    settings.draw.isVisible = settings_["visible"].toBool();
    settings.draw.castsShadows = settings_["cast_shadows"].toBool();
    settings.draw.layers = settings_["layers"].toInt();
    settings.space = settings_["space"];
    settings.colliderRadiusM = settings_["collider_radius_m"].toReal();
    settings.colliderLayer = settings_["collider_layer"].toInt();
    settings.maxTriangles = bound("max_triangles", 1);
    settings.maxSegments = bound("max_segments", 1);
    settings.maxPayloadBytes = bound("max_payload_mib", 1) * kMebibyte;
    settings.cacheBytes = bound("cache_mib", 0) * kMebibyte;
    settings.spareGpuBytes = bound("spare_mesh_mib", 1) * kMebibyte;
    settings.decodeThreads = settings_["decode_threads"].toInt();
    settings.autoShow = settings_["auto_show"].toBool();
    settings.showsCoarse = settings_["shows_coarse"].toBool();
    session_ = std::make_unique<Session>(std::move(settings), owner_);
  }

 private:
  static constexpr std::uint64_t kMebibyte = 1024 * 1024;

  std::string text(const char* name) {
    const Variant& value = settings_[name];
    return value.isNil() ? std::string() : value.toText();
  }

  std::uint64_t bound(const char* name, std::int64_t least) {
    return static_cast<std::uint64_t>(std::max(settings_[name].toInt(), least));
  }

  abi::Object* owner_;
  std::map<std::string, Variant> settings_;
  std::unique_ptr<Session> session_;
};

/// Arguments of a call, which the engine has counted.
using Arguments = const Variant*;
using Body = Variant (*)(Client& client, Arguments arguments);

struct ScriptMethod {
  const char* name;
  int count;
  Body body;
};

/// Of a session that may not be open: then nil.
template <typename Work>
Variant with(Client& client, Work&& work) {
  return client.session() != nullptr ? Variant(work(*client.session())) : Variant();
}

template <typename Work>
Variant onSocket(Work&& work) {
  if (SocketEvents* const socket = currentSocket()) work(*socket);
  return Variant();
}

Variant land(Client& client, Arguments given) {
  LandOptions options;
  if (given[2].toReal() > 0.0) options.innerRadiusM = given[2].toReal();
  if (given[3].toInt() > 0) options.deadlineMs = static_cast<std::uint32_t>(given[3].toInt());
  return with(client, [&](Session& session) { return session.land(given[0].toVec3(), given[1].toReal(), options); });
}

const ScriptMethod kMethods[] = {
    {"configure", 2, [](Client& client, Arguments given) { return client.configure(given[0].toText(), given[1]), Variant(); }},
    {"open", 0, [](Client& client, Arguments) { return client.open(), Variant(); }},
    {"close", 0, [](Client& client, Arguments) { return client.close(), Variant(); }},
    {"update", 1,
        [](Client& client, Arguments given) {
          return with(client, [&](Session& session) { return session.update(given[0].toReal()); });
        }},
    {"land", 4, land},
    {"aim", 2,
        [](Client& client, Arguments given) {
          return with(client, [&](Session& session) { return session.aim(given[0].toVec3(), given[1].toReal()), true; });
        }},
    {"pick", 2,
        [](Client& client, Arguments given) {
          return with(client, [&](Session& session) { return session.pick(given[0].toVec3(), given[1].toVec3()); });
        }},
    {"show", 0, [](Client& client, Arguments) { return with(client, [](Session& session) { return session.show(); }); }},
    {"set_shows_coarse", 1,
        [](Client& client, Arguments given) {
          return with(client, [&](Session& session) { return session.setShowsCoarse(given[0].toBool()), true; });
        }},
    {"set_auto_show", 1,
        [](Client& client, Arguments given) {
          return with(client, [&](Session& session) { return session.setAutoShow(given[0].toBool()), true; });
        }},
    {"reconnect", 1,
        [](Client& client, Arguments given) {
          return with(client, [&](Session& session) { return session.reconnect(given[0].toText()), true; });
        }},
    {"join_group", 3,
        [](Client& client, Arguments given) {
          return with(client,
              [&](Session& session) { return session.joinGroup(given[0].toText(), given[1].toBool(), given[2].toText()); });
        }},
    {"leave_group", 0,
        [](Client& client, Arguments) { return with(client, [](Session& session) { return session.leaveGroup(), true; }); }},
    {"gather", 2,
        [](Client& client, Arguments given) {
          return with(client, [&](Session& session) { return session.gather(given[0].toVec3(), given[1].toReal()); });
        }},
    {"go_to_group", 0,
        [](Client& client, Arguments) { return with(client, [](Session& session) { return session.goToGroup(); }); }},
    {"set_follows_group", 1,
        [](Client& client, Arguments given) {
          return with(client, [&](Session& session) { return session.setFollowsGroup(given[0].toBool()), true; });
        }},
    {"group", 0, [](Client& client, Arguments) { return with(client, [](Session& session) { return session.group(); }); }},
    {"cast", 3,
        [](Client& client, Arguments given) {
          return with(
              client, [&](Session& session) { return session.cast(given[0].toVec3(), given[1].toVec3(), given[2].toReal()); });
        }},
    {"status", 0, [](Client& client, Arguments) { return with(client, [](Session& session) { return session.status(); }); }},
    {"take_stats", 0,
        [](Client& client, Arguments) { return with(client, [](Session& session) { return session.takeStats(); }); }},
    {"manifest", 0,
        [](Client& client, Arguments) { return with(client, [](Session& session) { return session.manifest(); }); }},
    {"regions", 0, [](Client& client, Arguments) { return with(client, [](Session& session) { return session.regions(); }); }},
    {"places", 0, [](Client& client, Arguments) { return with(client, [](Session& session) { return session.places(); }); }},
    {"coarser_pieces", 1,
        [](Client& client, Arguments given) {
          return with(
              client, [&](Session& session) { return session.coarserPieces(static_cast<std::int64_t>(given[0].toReal())); });
        }},
    {"visible", 0, [](Client& client, Arguments) { return with(client, [](Session& session) { return session.visible(); }); }},
    {"digest", 0, [](Client& client, Arguments) { return with(client, [](Session& session) { return session.digest(); }); }},
    {"to_survey", 1,
        [](Client& client, Arguments given) {
          // Three numbers, not a vector: the engine's have 24 bits, and an easting of 4,000 km needs more.
          const Vec3 survey = client.session() != nullptr ? client.session()->toSurvey(given[0].toVec3()) : Vec3();
          List parts;
          for (const double part : {survey.x, survey.y, survey.z}) parts.add(part);
          return parts.variant();
        }},
    {"from_survey", 3,
        [](Client& client, Arguments given) {
          const Vec3 survey{given[0].toReal(), given[1].toReal(), given[2].toReal()};
          return with(client, [&](Session& session) { return session.fromSurvey(survey); });
        }},
    {"set_transform", 1,
        [](Client& client, Arguments given) {
          return with(client, [&](Session& session) { return session.setTransform(given[0]), true; });
        }},
    {"set_visible", 1,
        [](Client& client, Arguments given) {
          return with(client, [&](Session& session) { return session.renderer().setVisible(given[0].toBool()), true; });
        }},
    {"set_parameter", 2,
        [](Client& client, Arguments given) {
          return with(
              client, [&](Session& session) { return session.renderer().setParameter(given[0].toText(), given[1]), true; });
        }},
    // On the stream's thread, while it polls its socket.
    {"_on_socket_open", 1,
        [](Client&, Arguments given) { return onSocket([&](SocketEvents& socket) { socket.onOpen(given[0].toText()); }); }},
    {"_on_socket_failed", 0, [](Client&, Arguments) { return onSocket([](SocketEvents& socket) { socket.onFailed(); }); }},
    {"_on_socket_closing", 2,
        [](Client&, Arguments given) {
          return onSocket(
              [&](SocketEvents& socket) { socket.onClosing(static_cast<int>(given[0].toInt()), given[1].toText()); });
        }},
    {"_on_socket_closed", 1, [](Client&, Arguments) { return onSocket([](SocketEvents& socket) { socket.onClosed(); }); }},
    {"_on_socket_data", 0, [](Client&, Arguments) { return onSocket([](SocketEvents& socket) { socket.onData(); }); }},
};

void* create(abi::Object* owner, void*) {
  return new Client(owner);
}

void destroy(abi::Object*, void*, void* client) {
  delete static_cast<Client*>(client);
}

constexpr int kMostArguments = 4;

abi::Variant callMethod(abi::Object*, void* data, void* client, int count, abi::Variant** given) {
  const auto& method = *static_cast<const ScriptMethod*>(data);
  if (count != method.count) {
    printError(std::string("TerraportClient.") + method.name + ": got " + std::to_string(count) + " arguments, expected " +
        std::to_string(method.count));
    return Variant().release();
  }
  Variant arguments[kMostArguments];
  for (int at = 0; at < count; ++at) {
    // Borrowed from the engine: copied, and never destroyed here.
    abi::Variant raw = *given[at];
    Variant borrowed(raw);
    arguments[at] = borrowed;
    (void)borrowed.release();
  }
  return method.body(*static_cast<Client*>(client), arguments).release();
}

const abi::NativeScriptTable* gScripts = nullptr;

}  // namespace
}  // namespace terraport::godot

using namespace terraport::godot;

extern "C" {

__attribute__((visibility("default"))) void godot_gdnative_init(abi::InitOptions* options) {
  std::string missing;
  if (!begin(*options->core, missing)) {
    options->reportLoadingError(options->library, ("this engine has no " + missing + "; Godot 3.2 or a later 3.x has").c_str());
    return;
  }
  for (unsigned int at = 0; at < options->core->extensionCount; ++at) {
    if (options->core->extensions[at]->type == abi::kTypeNativeScript) {
      gScripts = reinterpret_cast<const abi::NativeScriptTable*>(options->core->extensions[at]);
    }
  }
}

__attribute__((visibility("default"))) void godot_gdnative_terminate(void*) {
  gScripts = nullptr;
}

__attribute__((visibility("default"))) void godot_nativescript_init(void* handle) {
  if (gScripts == nullptr) return;
  using RegisterClass = void(void*, const char*, const char*, abi::CreateFunction, abi::DestroyFunction);
  using RegisterMethod = void(void*, const char*, const char*, int, abi::MethodFunction);
  const auto registerClass = reinterpret_cast<RegisterClass*>(gScripts->functions[abi::kRegisterClass]);
  const auto registerMethod = reinterpret_cast<RegisterMethod*>(gScripts->functions[abi::kRegisterMethod]);
  constexpr char kClass[] = "TerraportClient";
  registerClass(handle, kClass, "Reference", {create, nullptr, nullptr}, {destroy, nullptr, nullptr});
  for (const ScriptMethod& method : kMethods) {
    registerMethod(handle, kClass, method.name, 0, {callMethod, const_cast<ScriptMethod*>(&method), nullptr});
  }
}
}
