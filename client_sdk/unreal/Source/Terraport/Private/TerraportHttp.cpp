#include "TerraportHttp.h"

#include "HttpModule.h"
#include "Interfaces/IHttpRequest.h"
#include "Interfaces/IHttpResponse.h"
#include "TerraportText.h"

#include <algorithm>
#include <utility>

struct FTerraportHttp::FExchange
{
	TSharedPtr<IHttpRequest, ESPMode::ThreadSafe> Request;
	std::size_t MaxBytes = 0;
	std::uint64_t Received = 0;
	bool bIsOver = false;
	terraport::HttpAnswer Answer;

	/** More than was allowed: the rest is not waited for. The module then reports a failure, which says less than this. */
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
		const std::size_t BodyBytes = std::min(std::size_t(Content.Num()), MaxBytes);
		Answer.body.assign(Content.GetData(), Content.GetData() + BodyBytes);
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
	const TSharedRef<FExchange> Exchange = MakeShared<FExchange>();
	Exchange->MaxBytes = MaxBytes;
	const TSharedRef<IHttpRequest, ESPMode::ThreadSafe> Request = FHttpModule::Get().CreateRequest();
	Exchange->Request = Request;
	Request->SetURL(TerraportText::FromUtf8(Url));
	Request->SetVerb(TEXT("GET"));
	if (!BearerToken.empty())
	{
		Request->SetHeader(TEXT("Authorization"), TEXT("Bearer ") + TerraportText::FromUtf8(BearerToken));
	}
	Request->OnProcessRequestComplete().BindLambda(
		[Exchange](FHttpRequestPtr, FHttpResponsePtr Response, bool bConnected) { Exchange->Finish(Response, bConnected); });
	Request->OnRequestProgress64().BindLambda(
		[Exchange](FHttpRequestPtr, uint64, uint64 Received) { Exchange->Note(Received); });
	++Last;
	Requests[Last] = Exchange;
	if (!Request->ProcessRequest())
	{
		Exchange->Finish(FHttpResponsePtr(), false);
	}
	return Last;
}

bool FTerraportHttp::poll(std::uint64_t Request, terraport::HttpAnswer& Answer)
{
	const auto Entry = Requests.find(Request);
	if (Entry == Requests.end() || !Entry->second->bIsOver)
	{
		return false;
	}
	Answer = std::move(Entry->second->Answer);
	// It and its request hold one another.
	Entry->second->Request.Reset();
	Requests.erase(Entry);
	return true;
}

void FTerraportHttp::cancel(std::uint64_t Request)
{
	const auto Entry = Requests.find(Request);
	if (Entry == Requests.end())
	{
		return;
	}
	const TSharedPtr<FExchange> Exchange = Entry->second;
	Requests.erase(Entry);
	if (Exchange->Request.IsValid())
	{
		Exchange->Request->OnProcessRequestComplete().Unbind();
		if (!Exchange->bIsOver)
		{
			Exchange->Request->CancelRequest();
		}
		Exchange->Request.Reset();
	}
}
