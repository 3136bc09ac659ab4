// A session behind a host that is no actor: what it reports, and what it reads anew.
#include "TerraportGroundBackend.h"
#include "TerraportSession.h"

#include "GameFramework/Actor.h"
#include "HttpModule.h"
#include "Interfaces/IHttpRequest.h"
#include "Materials/MaterialInterface.h"

#include <doctest/doctest.h>

#include <functional>
#include <memory>
#include <vector>

namespace
{
/// Fails as soon as it is begun: no network.
class FUnreachableRequest final : public IHttpRequest
{
public:
	virtual void SetURL(const FString& InUrl) override { Url = InUrl; }
	virtual void SetVerb(const FString&) override {}
	virtual void SetHeader(const FString& Name, const FString& Value) override
	{
		if (Name == FString(TEXT("Authorization")))
		{
			Authorization = Value;
		}
	}
	virtual bool ProcessRequest() override { return false; }
	virtual void CancelRequest() override {}
	virtual FHttpRequestCompleteDelegate& OnProcessRequestComplete() override { return Complete; }
	virtual FHttpRequestProgressDelegate64& OnRequestProgress64() override { return Progress; }

	FString Url;
	FString Authorization;
	FHttpRequestCompleteDelegate Complete;
	FHttpRequestProgressDelegate64 Progress;
};

/// What a test sees of a session, and sets for it; the host itself belongs to the session.
struct FSessionRecord
{
	FString SceneUrl = TEXT("http://first/scenes/quarry");
	std::vector<FTerraportFailure> Failures;
	int OtherEvents = 0;
	std::function<void()> OnFailed = [] {};
};

class FRecordingHost final : public ITerraportSessionHost
{
public:
	explicit FRecordingHost(FSessionRecord& InRecord) : Record(InRecord) {}
	virtual FString GetSceneUrl() const override { return Record.SceneUrl; }
	virtual double GetFrameBudgetMs() const override { return 2.0; }
	virtual bool IsAutoShow() const override { return true; }
	virtual bool ShowsCoarse() const override { return true; }
	virtual void OnOpened() override { ++Record.OtherEvents; }
	virtual void OnLink(const FTerraportLink&) override { ++Record.OtherEvents; }
	virtual void OnPlan(const FTerraportPlan&) override { ++Record.OtherEvents; }
	virtual void OnReady(const FTerraportReady&) override { ++Record.OtherEvents; }
	virtual void OnDegraded(int64) override { ++Record.OtherEvents; }
	virtual void OnPresentable(int64) override { ++Record.OtherEvents; }
	virtual void OnShown(const FTerraportSwap&) override { ++Record.OtherEvents; }
	virtual void OnPicked(const FTerraportPick&) override { ++Record.OtherEvents; }
	virtual void OnFailed(const FTerraportFailure& Failure) override
	{
		Record.Failures.push_back(Failure);
		Record.OnFailed();
	}

private:
	FSessionRecord& Record;
};

struct FSessionStand
{
	FSessionStand()
	{
		FHttpModule::Get().StubMake = [this]() -> TSharedRef<IHttpRequest, ESPMode::ThreadSafe> {
			const TSharedRef<FUnreachableRequest> Request = MakeShared<FUnreachableRequest>();
			Requests.push_back(Request);
			return Request;
		};
	}
	void Open()
	{
		Session = std::make_unique<FTerraportSession>(Actor, std::make_unique<FRecordingHost>(Record), Settings,
			ReferencedObjects, MakeShared<FTerraportGroundBackend>());
	}

	std::vector<TSharedRef<FUnreachableRequest>> Requests;
	FSessionRecord Record;
	FTerraportSessionSettings Settings;
	TSet<TObjectPtr<UObject>> ReferencedObjects;
	AActor Actor;
	std::unique_ptr<FTerraportSession> Session;
};
} // namespace

TEST_CASE("a session that cannot open says so once, for good, and may be ended by the listener")
{
	FSessionStand Stand;
	Stand.Record.SceneUrl = TEXT("no address");
	Stand.Record.OnFailed = [&Stand] { Stand.Session->End(); };
	Stand.Open();
	CHECK(Stand.Record.Failures.empty());
	Stand.Session->Tick();
	Stand.Session->Tick();
	REQUIRE(Stand.Record.Failures.size() == 1);
	CHECK(Stand.Record.Failures[0].bFatal);
	CHECK(Stand.Record.Failures[0].Code == FString(TEXT("invalid_url")));
	CHECK(Stand.Session->GetGround() == nullptr);
	CHECK(Stand.Record.OtherEvents == 0);
	CHECK(Stand.Requests.empty());
}

TEST_CASE("an unreachable server is no end, and the next attempt reads the address anew")
{
	FSessionStand Stand;
	Stand.Open();
	Stand.Session->Tick();
	REQUIRE(Stand.Record.Failures.size() == 1);
	CHECK_FALSE(Stand.Record.Failures[0].bFatal);
	CHECK(Stand.Record.Failures[0].Code == FString(TEXT("unreachable")));
	Stand.Record.SceneUrl = TEXT("http://second/scenes/quarry");
	Stand.Session->Reconnect("");
	REQUIRE(Stand.Requests.size() == 2);
	CHECK(Stand.Requests[0]->Url == FString(TEXT("http://first/scenes/quarry")));
	CHECK(Stand.Requests[1]->Url == FString(TEXT("http://second/scenes/quarry")));
}

TEST_CASE("a token provider is asked for each loading, until a token is given by hand")
{
	FSessionStand Stand;
	int Asked = 0;
	Stand.Settings.Token = "fixed";
	Stand.Settings.TokenProvider = [&Asked] { return "present " + std::to_string(++Asked); };
	Stand.Open();
	Stand.Session->Tick();
	Stand.Session->Reconnect("");
	Stand.Session->Tick();
	Stand.Session->Reconnect("by hand");
	REQUIRE(Stand.Requests.size() == 3);
	CHECK(Stand.Requests[0]->Authorization == FString(TEXT("Bearer present 1")));
	CHECK(Stand.Requests[1]->Authorization == FString(TEXT("Bearer present 2")));
	CHECK(Stand.Requests[2]->Authorization == FString(TEXT("Bearer by hand")));
}

TEST_CASE("a session keeps its materials from the collector until its end, the fallback where none is chosen")
{
	FSessionStand Stand;
	UMaterialInterface Base;
	Stand.Settings.Materials.BaseColour = &Base;
	Stand.Open();
	CHECK(Stand.ReferencedObjects.Num() == 2);
	Stand.Session->End();
	CHECK(Stand.ReferencedObjects.Num() == 0);
}
