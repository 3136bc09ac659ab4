#include "TerraportHttp.h"

#include "HttpModule.h"
#include "Interfaces/IHttpRequest.h"
#include "Interfaces/IHttpResponse.h"
#include "Misc/EngineVersionComparison.h"
#include "TerraportText.h"

#include <algorithm>
#include <utility>

struct FTerraportHttp::FOne
{
	TSharedPtr<IHttpRequest, ESPMode::ThreadSafe> Request;
	std::size_t MaxBytes = 0;
	std::uint64_t Received = 0;
	bool bIsOver = false;
	terraport::HttpAnswer Answer;

	/** More than was allowed: the rest is not waited for. The module then tells of a failure, which says less than this. */
	void Refuse()
	{
		Answer.isTooLarge = true;
		if (Request.IsValid())
		{
			Request->CancelRequest();
		}
	}

	void Note(std::uint64_t Bytes)
	{
		Received = Bytes;
		if (!bIsOver && Bytes > MaxBytes && !Answer.isTooLarge)
		{
			Refuse();
		}
	}

	void Finish(const FHttpResponsePtr& Response, bool bConnected)
	{
		bIsOver = true;
		if (!bConnected || !Response.IsValid())
		{
			Answer.reason = Answer.isTooLarge ? "the answer is longer than it may be" : "the connection failed";
			return;
		}
		Answer.status = int(Response->GetResponseCode());
		const TArray<uint8>& Content = Response->GetContent();
		Answer.isTooLarge = Answer.isTooLarge || std::size_t(Content.Num()) > MaxBytes;
		const std::size_t Kept = std::min(std::size_t(Content.Num()), MaxBytes);
		Answer.body.assign(Content.GetData(), Content.GetData() + Kept);
		Received = Answer.body.size();
	}
};

FTerraportHttp::~FTerraportHttp()
{
	while (!Requests.empty())
	{
		cancel(Requests.begin()->first);
	}
}

std::uint64_t FTerraportHttp::get(const std::string& Url, const std::string& BearerToken, std::size_t MaxBytes)
{
	const TSharedRef<FOne> One = MakeShared<FOne>();
	One->MaxBytes = MaxBytes;
	const TSharedRef<IHttpRequest, ESPMode::ThreadSafe> Request = FHttpModule::Get().CreateRequest();
	One->Request = Request;
	Request->SetURL(TerraportText::FromUtf8(Url));
	Request->SetVerb(TEXT("GET"));
	if (!BearerToken.empty())
	{
		Request->SetHeader(TEXT("Authorization"), TEXT("Bearer ") + TerraportText::FromUtf8(BearerToken));
	}
	Request->OnProcessRequestComplete().BindLambda(
		[One](FHttpRequestPtr, FHttpResponsePtr Response, bool bConnected) { One->Finish(Response, bConnected); });
#if UE_VERSION_OLDER_THAN(5, 4, 0)
	Request->OnRequestProgress().BindLambda(
		[One](FHttpRequestPtr, int32, int32 Received) { One->Note(std::uint64_t(std::max(Received, 0))); });
#else
	Request->OnRequestProgress64().BindLambda([One](FHttpRequestPtr, uint64, uint64 Received) { One->Note(Received); });
#endif
	++Last;
	Requests[Last] = One;
	if (!Request->ProcessRequest())
	{
		One->Finish(FHttpResponsePtr(), false);
	}
	return Last;
}

bool FTerraportHttp::poll(std::uint64_t Request, terraport::HttpAnswer& Answer)
{
	const auto Found = Requests.find(Request);
	if (Found == Requests.end() || !Found->second->bIsOver)
	{
		return false;
	}
	Answer = std::move(Found->second->Answer);
	// It and its request hold one another.
	Found->second->Request.Reset();
	Requests.erase(Found);
	return true;
}

std::uint64_t FTerraportHttp::receivedBytes(std::uint64_t Request) const
{
	const auto Found = Requests.find(Request);
	return Found == Requests.end() ? 0 : Found->second->Received;
}

void FTerraportHttp::cancel(std::uint64_t Request)
{
	const auto Found = Requests.find(Request);
	if (Found == Requests.end())
	{
		return;
	}
	const TSharedPtr<FOne> One = Found->second;
	Requests.erase(Found);
	if (One->Request.IsValid())
	{
		One->Request->OnProcessRequestComplete().Unbind();
		if (!One->bIsOver)
		{
			One->Request->CancelRequest();
		}
		One->Request.Reset();
	}
}
