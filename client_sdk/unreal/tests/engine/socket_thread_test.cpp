// When the pace of the engine's WebSockets thread is set, and when a warning is logged.
#include "TerraportSocketThread.h"

#include "Misc/ConfigCacheIni.h"
#include "Modules/ModuleManager.h"
#include "TerraportWebSocket.h"
#include "WebSocketsModule.h"
#include "socket_events.h"

#include <doctest/doctest.h>

#include <string>

IModuleInterface& StubModuleTerraport();

namespace
{
constexpr const TCHAR* Section = TEXT("WebSockets.LibWebSockets");
constexpr const TCHAR* FrameTime = TEXT("ThreadTargetFrameTimeInSeconds");
constexpr const TCHAR* LeastSleep = TEXT("ThreadMinimumSleepTimeInSeconds");

/// An engine that has just read its configuration; leaves none behind.
class FFreshEngine
{
public:
	FFreshEngine() { Clear(); }
	~FFreshEngine() { Clear(); }
	double FrameTimeS() const
	{
		double Value = -1.0;
		GConfig->GetDouble(Section, FrameTime, Value, GEngineIni);
		return Value;
	}
	/// Warnings of the plugin's start.
	std::size_t Start()
	{
		const std::size_t Before = StubWarnings.size();
		StubModuleTerraport().StartupModule();
		return StubWarnings.size() - Before;
	}
	void Load() { FModuleManager::Get().LoadModule(TEXT("WebSockets")); }

private:
	static void Clear()
	{
		StubConfig = FConfigCacheIni();
		FModuleManager::Get().StubLoaded.clear();
		FModuleManager::Get().StubOnLoad = nullptr;
	}
};

class FNoSocket final : public FSocketEvents
{
public:
	virtual void Connect() override {}
	virtual void Close(int32, const FString&) override {}
	virtual bool IsConnected() override { return false; }
	virtual void Send(const FString&) override {}
	virtual void Send(const void*, SIZE_T, bool) override {}
};

class FSocketModule final : public FWebSocketsModule
{
public:
	FSocketModule() { Stub = this; }
	virtual ~FSocketModule() override { Stub = nullptr; }
	virtual TSharedRef<IWebSocket> CreateWebSocket(
		const FString&, const TArray<FString>&, const TMap<FString, FString>&) override
	{
		return MakeShared<FNoSocket>();
	}
};
} // namespace

TEST_CASE("the module finds the pace set when the first connection loads it")
{
	for (const double EnginesS : {0.0, 0.0333, 1.0 / 30.0})
	{
		FFreshEngine Engine;
		FSocketModule Module;
		if (EnginesS > 0.0)
		{
			GConfig->SetDouble(Section, FrameTime, EnginesS, GEngineIni);
		}
		CHECK(Engine.Start() == 0);
		CHECK_FALSE(FModuleManager::Get().IsModuleLoaded(TEXT("WebSockets")));
		double AtLoadS = -1.0;
		FModuleManager::Get().StubOnLoad = [&](const FName&) { AtLoadS = Engine.FrameTimeS(); };
		FTerraportWebSocket Socket;
		Socket.open("ws://host/scenes/q/stream", {"terraport.v1.msgpack"}, "");
		CHECK(AtLoadS == TerraportSocketThread::FrameTimeS);
	}
}

TEST_CASE("where the module was loaded before, nothing is changed, and the log says what to write")
{
	FFreshEngine Engine;
	GConfig->SetDouble(Section, FrameTime, 0.0333, GEngineIni);
	Engine.Load();
	CHECK(Engine.Start() == 1);
	CHECK(Engine.FrameTimeS() == 0.0333);
	const std::u16string Warning = StubWarnings.back();
	CHECK(Warning.find(u"DefaultEngine.ini") != std::u16string::npos);
	CHECK(Warning.find(u"[WebSockets.LibWebSockets] ThreadTargetFrameTimeInSeconds") != std::u16string::npos);

	FFreshEngine Unset;
	Unset.Load();
	CHECK(Unset.Start() == 1);
}

TEST_CASE("loaded before with a quick pace is no reason to complain")
{
	FFreshEngine Engine;
	GConfig->SetDouble(Section, FrameTime, 0.001, GEngineIni);
	Engine.Load();
	CHECK(Engine.Start() == 0);
}

TEST_CASE("a project's own setting stays, quicker or slower; a slow one is told")
{
	for (const double OwnS : {0.0, 0.0005, 0.004, 0.02, 0.1})
	{
		FFreshEngine Engine;
		GConfig->SetDouble(Section, FrameTime, OwnS, GEngineIni);
		CHECK(Engine.Start() == (OwnS > 0.005 ? 1 : 0));
		CHECK(Engine.FrameTimeS() == OwnS);
	}
}

TEST_CASE("a least sleep that is slow is told")
{
	FFreshEngine Engine;
	GConfig->SetDouble(Section, LeastSleep, 0.02, GEngineIni);
	CHECK(Engine.Start() == 1);
	CHECK(Engine.FrameTimeS() == TerraportSocketThread::FrameTimeS);
}

TEST_CASE("where the engine waits for its sockets there is no pace to complain of")
{
	FFreshEngine Engine;
	GConfig->SetBool(Section, TEXT("bPollService"), false, GEngineIni);
	Engine.Load();
	CHECK(Engine.Start() == 0);
}

TEST_CASE("without a configuration nothing happens")
{
	FFreshEngine Engine;
	GConfig = nullptr;
	CHECK(Engine.Start() == 0);
	GConfig = &StubConfig;
}
