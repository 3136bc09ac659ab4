#include "TerraportHttp.h"

#include "HttpModule.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <string>
#include <vector>

namespace
{
class FFakeResponse final : public IHttpResponse
{
public:
	FFakeResponse(int32 InCode, const std::string& Text) : Code(InCode)
	{
		Content.SetNumUninitialized(int32(Text.size()));
		std::copy(Text.begin(), Text.end(), Content.begin());
	}
	virtual int32 GetResponseCode() const override { return Code; }
	virtual const TArray<uint8>& GetContent() const override { return Content; }

private:
	int32 Code;
	TArray<uint8> Content;
};

class FFakeRequest final : public IHttpRequest
{
public:
	virtual void SetURL(const FString& InUrl) override { Url = InUrl; }
	virtual void SetVerb(const FString&) override {}
	virtual void SetHeader(const FString& Name, const FString& Value) override { Headers[Name] = Value; }
	virtual bool ProcessRequest() override { return bStarts; }
	virtual void CancelRequest() override
	{
		bCancelled = true;
		// As the module does it: a request that is given up has failed.
		Complete.ExecuteIfBound(FHttpRequestPtr(), FHttpResponsePtr(), false);
	}
	virtual FHttpRequestCompleteDelegate& OnProcessRequestComplete() override { return Complete; }
	virtual FHttpRequestProgressDelegate64& OnRequestProgress64() override { return Progress; }
	void Answer(int32 Code, const std::string& Text)
	{
		Complete.ExecuteIfBound(FHttpRequestPtr(), MakeShared<FFakeResponse>(Code, Text), true);
	}

	FString Url;
	std::map<FString, FString> Headers;
	FHttpRequestCompleteDelegate Complete;
	FHttpRequestProgressDelegate64 Progress;
	bool bStarts = true;
	bool bCancelled = false;
};

struct FHttpStand
{
	FHttpStand()
	{
		FHttpModule::Get().StubMake = [this]() -> TSharedRef<IHttpRequest, ESPMode::ThreadSafe> {
			const TSharedRef<FFakeRequest> Request = MakeShared<FFakeRequest>();
			Request->bStarts = bStarts;
			All.push_back(Request);
			return Request;
		};
	}
	FFakeRequest& Newest() { return *All.back(); }
	bool bStarts = true;
	std::vector<TSharedRef<FFakeRequest>> All;
};
} // namespace

TEST_CASE("an answer comes with status and body, once; the token is a header")
{
	FHttpStand Stand;
	FTerraportHttp Http;
	terraport::HttpAnswer Answer;
	const std::uint64_t Request = Http.get("http://host/scenes/q", "s3cret", 100);
	CHECK(Request != 0);
	CHECK_FALSE(Http.poll(Request, Answer));
	CHECK(Stand.Newest().Headers[TEXT("Authorization")] == FString(TEXT("Bearer s3cret")));
	Stand.Newest().Progress.ExecuteIfBound(FHttpRequestPtr(), 0, 3);
	CHECK(Http.receivedBytes(Request) == 3);
	Stand.Newest().Answer(404, "{\"error\":1}");
	REQUIRE(Http.poll(Request, Answer));
	CHECK(Answer.status == 404);
	CHECK(std::string(Answer.body.begin(), Answer.body.end()) == "{\"error\":1}");
	CHECK_FALSE(Answer.isTooLarge);
	CHECK_FALSE(Http.poll(Request, Answer));
	Http.get("http://host/scenes/q", "", 100);
	CHECK(Stand.Newest().Headers.empty());
}

TEST_CASE("a body that is longer than it may be is given up as soon as that is seen")
{
	FHttpStand Stand;
	FTerraportHttp Http;
	terraport::HttpAnswer Answer;
	const std::uint64_t Slow = Http.get("http://host/a", "", 10);
	Stand.Newest().Progress.ExecuteIfBound(FHttpRequestPtr(), 0, 11);
	CHECK(Stand.Newest().bCancelled);
	REQUIRE(Http.poll(Slow, Answer));
	CHECK(Answer.isTooLarge);
	const std::uint64_t AtOnce = Http.get("http://host/a", "", 10);
	Stand.Newest().Answer(200, "0123456789abc");
	REQUIRE(Http.poll(AtOnce, Answer));
	CHECK(Answer.isTooLarge);
	CHECK(Answer.body.size() == 10);
}

TEST_CASE("without a connection there is a reason and no status")
{
	FHttpStand Stand;
	FTerraportHttp Http;
	terraport::HttpAnswer Answer;
	const std::uint64_t Request = Http.get("http://host/a", "", 10);
	Stand.Newest().Complete.ExecuteIfBound(FHttpRequestPtr(), FHttpResponsePtr(), false);
	REQUIRE(Http.poll(Request, Answer));
	CHECK(Answer.status == 0);
	CHECK_FALSE(Answer.reason.empty());
	Stand.bStarts = false;
	const std::uint64_t Never = Http.get("http://host/a", "", 10);
	REQUIRE(Http.poll(Never, Answer));
	CHECK(Answer.status == 0);
}

TEST_CASE("what was given up is heard of no more, and nothing is left of it")
{
	FHttpStand Stand;
	std::weak_ptr<FFakeRequest> CancelledRequest;
	{
		FTerraportHttp Http;
		const std::uint64_t Request = Http.get("http://host/a", "", 10);
		Http.cancel(Request);
		CHECK(Stand.Newest().bCancelled);
		terraport::HttpAnswer Answer;
		CHECK_FALSE(Http.poll(Request, Answer));
		Http.get("http://host/b", "", 10);
		CancelledRequest = Stand.All.back().StubObject;
	}
	CHECK(Stand.Newest().bCancelled);
	Stand.All.clear();
	CHECK(CancelledRequest.expired());
}
