#pragma once

#include "CoreMinimal.h"

#include "Core/Link.h"
#include "Core/SceneLoader.h"
#include "Core/Stage.h"
#include "TerraportDecodes.h"
#include "TerraportFeet.h"
#include "TerraportHttp.h"
#include "TerraportKeeper.h"
#include "TerraportRenderer.h"
#include "TerraportTypes.h"

#include <memory>
#include <string>
#include <variant>
#include <vector>

class ATerraportScene;

/**
 * Everything of a scene between Open and Close: files, connection, stage, renderer. Game thread.
 *
 * Listeners of the actor's events may call anything of it, Close and Open included: no event is raised from within a call of
 * the core, and after each of them `bEnded` says whether this session still counts.
 */
class FTerraportSession final
{
public:
	/** Takes the scene's properties as they are now. `ReferencedObjects` is followed by the garbage collector; both outlive
	 * this. */
	FTerraportSession(
		ATerraportScene& Scene, const FTerraportTokenProvider& TokenProvider, TSet<TObjectPtr<UObject>>& ReferencedObjects);
	~FTerraportSession();
	FTerraportSession(const FTerraportSession&) = delete;
	FTerraportSession& operator=(const FTerraportSession&) = delete;

	/** Once a frame: load, receive, draw and report, within the frame's budget. May end this session, by a listener. */
	void Tick();
	/** Free everything now. No event is raised any more. */
	void End();

	int64 Land(const terraport::Vec3& Position, double RadiusM, const terraport::LandOptions& Options);
	void Aim(const terraport::Vec3& Position, double RadiusM);
	int64 Pick(const terraport::Vec3& Origin, const terraport::Vec3& Direction);
	bool Show();
	void Reconnect(const FString& NewToken);
	/** Once a frame after Tick, where somebody walks: the ground around the feet is solid. */
	void StepFeet(const terraport::Vec3& Place, double HalfM, int32 MaxFaces);
	FTerraportStats TakeStats();

	/** Null before the scene was loaded. */
	const terraport::Stage* GetStage() const { return Stage.get(); }
	terraport::SharedScene GetScene() const { return Stage ? Stage->scene() : nullptr; }
	const terraport::SessionCounts& GetCounts() const { return Core->counts(); }

	// Groups, for UTerraportGroupComponent.
	/** Null before the scene was loaded. */
	terraport::Seat* GetSeat() { return Core ? &Core->seat() : nullptr; }
	bool JoinGroup(const std::string& Name, bool bAsGuide, const std::string& OwnName);
	/** What happened in the group since the last call. */
	std::vector<terraport::GroupEvent> TakeGroupEvents() { return std::exchange(GroupEvents, {}); }

private:
	using FNews = std::variant<terraport::Event, terraport::LinkState>;
	struct FLoading;
	struct FPending
	{
		terraport::Vec3 Position;
		double RadiusM = 0.0;
		terraport::LandOptions Options;
	};

	std::string PresentToken() const;
	void StartLoading();
	void PollLoading(double NowMs);
	void TakeScene(const FLoading& Loaded, double NowMs);
	void Connect(const terraport::SceneUrl& Url, const terraport::Scene& Loaded);
	void Handle(FNews& News, double NowMs);
	void Report(const terraport::Event& Event);
	void ReportLink(const terraport::LinkState& Link);
	void ReportDrawn();
	void ReportFailure(const std::string& Code, const std::string& Message, int64 Landing, bool bFatal);

	ATerraportScene& Scene;
	FTerraportKeeper Keeper;
	const FTerraportBudgets Budgets;
	FTerraportTokenProvider TokenProvider;
	std::string Token;
	const FTerraportMaterials Materials;
	bool bEnded = false;
	std::unique_ptr<FLoading> Loading;
	/** When to try again to load, milliseconds; 0 for not at all. */
	double RetryAtMs = 0.0;
	int32 LoadAttempt = 0;
	/** Of the newest connection. */
	std::string Version;
	/** In the order in which they need one another: destroyed the other way round. */
	std::unique_ptr<FTerraportRenderer> Renderer;
	std::shared_ptr<terraport::DiskCache> Disk;
	std::unique_ptr<FTerraportDecodes> Decodes;
	std::unique_ptr<terraport::Session> Core;
	std::unique_ptr<terraport::Link> Link;
	std::unique_ptr<terraport::Stage> Stage;
	/** Null where nobody walks. */
	std::unique_ptr<FTerraportFeet> Feet;
	std::vector<FNews> Inbox;
	std::vector<terraport::GroupEvent> GroupEvents;
	TOptional<FPending> Pending;
	int64 ReportedPresentable = -1;
	bool bReportedInFull = false;
	/** Said once: a scene has one kind of images throughout. */
	bool bReportedUnread = false;
	double MaxFrameMs = 0.0;
};
