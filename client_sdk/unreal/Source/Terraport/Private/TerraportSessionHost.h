#pragma once

#include "CoreMinimal.h"
#include "TerraportTypes.h"

/**
 * What a session knows of the scene that opened it: the properties that may change while it runs, and where its events go.
 * Game thread.
 *
 * A listener behind an event may do anything, End of the session that raised it included; the session is alive until the call
 * returns.
 */
class ITerraportSessionHost
{
public:
	virtual ~ITerraportSessionHost() = default;

	/** Read anew whenever it is needed: users set these at any time. */
	virtual FString GetSceneUrl() const = 0;
	virtual double GetFrameBudgetMs() const = 0;
	virtual bool IsAutoShow() const = 0;
	virtual bool ShowsCoarse() const = 0;

	virtual void OnOpened() = 0;
	virtual void OnLink(const FTerraportLink& Link) = 0;
	virtual void OnPlan(const FTerraportPlan& Plan) = 0;
	virtual void OnReady(const FTerraportReady& Ready) = 0;
	virtual void OnDegraded(int64 Landing) = 0;
	virtual void OnPresentable(int64 Landing) = 0;
	virtual void OnShown(const FTerraportSwap& Swap) = 0;
	virtual void OnFailed(const FTerraportFailure& Failure) = 0;
	virtual void OnPicked(const FTerraportPick& Pick) = 0;
};
