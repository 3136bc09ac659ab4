#pragma once

#include "CoreMinimal.h"

#include "Terraport/GroupFollower.h"
#include "Terraport/SceneStage.h"
#include "Terraport/SceneStream.h"
#include "Terraport/ShownGround.h"
#include "TerraportDecodes.h"
#include "TerraportFeet.h"
#include "TerraportFiles.h"
#include "TerraportKeeper.h"
#include "TerraportRenderer.h"
#include "TerraportSessionHost.h"
#include "TerraportSettings.h"
#include "TerraportTypes.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

class AActor;

/** The properties of a scene that count when it opens, as they were then. */
struct FTerraportSessionSettings
{
	/** UTF-8; empty for none. */
	std::string Token;
	/** Asked for each connection and each loading in place of it; null without. */
	std::function<std::string()> TokenProvider;
	FTerraportBudgets Budgets;
	/** Payloads decoded at a time; below 1 counts as 1. */
	int32 DecodeTasks = 1;
	FTerraportMeshSettings Mesh;
	FTerraportMaterials Materials;
	/** Of the materials that are found by themselves the lit ones. */
	bool bLit = false;
	ETerraportVertexColours VertexColours = ETerraportVertexColours::Srgb;
};

/**
 * Everything of a scene between Open and Close: files, stream, stage, renderer. Game thread.
 *
 * Listeners of the actor's events may call anything of it, Close and Open included: Host is never called from within a call of
 * the core, and after each call of it `bEnded` says whether this session still counts.
 */
class FTerraportSession final
{
public:
	/** Components are made in `Owner`. `ReferencedObjects` is followed by the garbage collector, and both outlive this. */
	FTerraportSession(AActor& Owner, std::unique_ptr<ITerraportSessionHost> Host, const FTerraportSessionSettings& Settings,
		TSet<TObjectPtr<UObject>>& ReferencedObjects, TSharedRef<ITerraportMeshBackend, ESPMode::ThreadSafe> Backend);
	~FTerraportSession();
	FTerraportSession(const FTerraportSession&) = delete;
	FTerraportSession& operator=(const FTerraportSession&) = delete;

	/** Once a frame: load, receive, draw and report, within the frame's budget. May end this session, by a listener. */
	void Tick();
	/** Free everything now. Host is not called any more. */
	void End();

	int64 Land(const terraport::Vec3& Position, double RadiusM, const terraport::LandOptions& Options);
	void Aim(const terraport::Vec3& Position, double RadiusM);
	/** Once a frame after Tick, where somebody walks: the ground around the feet is solid. */
	void StepFeet(const terraport::Vec3& Place, double HalfM, int32 MaxFaces);
	int64 Pick(const terraport::Vec3& Origin, const terraport::Vec3& Direction);
	/** Land the group; false where a number cannot be. */
	bool Gather(const terraport::Vec3& Position, double RadiusM);
	/** The landing's number; 0 where the group is nowhere. */
	int64 GoToGroup();
	/** What happened in the group since this was asked last, the newest of it. */
	std::vector<terraport::StreamEvent> TakeGroupNews();
	bool Show();
	void Reconnect(const std::string& NewToken);

	/** Null before the scene is open. */
	const terraport::SceneStage* GetStage() const { return Stage.get(); }
	terraport::GroupFollower* GetFollower() const { return Follower.get(); }
	const terraport::ShownGround* GetGround() const { return Ground.get(); }
	FTerraportStats TakeStats();

private:
	struct FPending
	{
		terraport::Vec3 Position;
		double RadiusM = 0.0;
		terraport::LandOptions Options;
	};

	void StartLoading();
	void PollLoading(double NowMs);
	void RetryLater(double NowMs);
	void TakeFiles(FTerraportFilesResult& Result, double NowMs);
	bool MakeStream(const FTerraportFilesResult& Files);
	void Draw(double NowMs, double EndMs);
	void NoteGroup(const terraport::StreamEvent& Event);
	void ReportSwaps();
	void ReportPresentable();
	void ReportUnread();
	void Report(const terraport::StreamEvent& Event);
	void ReportLink(const terraport::LinkState& Link);
	void ReportFailure(const std::string& Code, const std::string& Message, int64 Landing, bool bFatal);
	uint64 GpuShareBytes() const;
	terraport::StreamOptions StreamOptionsOf(const FTerraportFilesResult& Files) const;
	FTerraportMaterials MaterialsOf(const FTerraportMaterials& Chosen, bool bLit);

	AActor& Owner;
	const std::unique_ptr<ITerraportSessionHost> Host;
	FTerraportKeeper Keeper;
	const TSharedRef<ITerraportMeshBackend, ESPMode::ThreadSafe> Backend;
	std::string Token;
	std::function<std::string()> TokenProvider;
	/** Of the scene, as the connection has it; empty before there was one. */
	std::string StreamVersion;
	const FTerraportBudgets Budgets;
	/** As the material for vertex colours wants them. */
	ETerraportVertexColours Colours;
	bool bEnded = false;
	std::unique_ptr<FTerraportFiles> Loading;
	/** When to try again to load, milliseconds; 0 for not at all. */
	double RetryAtMs = 0.0;
	int32 LoadAttempt = 0;
	/** In the order in which they need one another: destroyed the other way round. */
	std::unique_ptr<FTerraportRenderer> Renderer;
	std::unique_ptr<terraport::ShownGround> Ground;
	/** Null where nobody walks. */
	std::unique_ptr<FTerraportFeet> Feet;
	std::unique_ptr<FTerraportDecodes> Decodes;
	std::unique_ptr<terraport::SceneStream> Stream;
	std::unique_ptr<terraport::SceneStage> Stage;
	std::unique_ptr<terraport::GroupFollower> Follower;
	std::vector<terraport::StreamEvent> GroupNews;
	/** What the renderer draws with, held for as long as it does. */
	std::vector<UMaterialInterface*> KeptMaterials;
	TOptional<FPending> Pending;
	std::vector<terraport::SceneSwap> Swaps;
	int64 ReportedPresentable = -1;
	bool bReportedPresentableInFull = false;
	/** Said once: a scene has one kind of images throughout. */
	bool bReportedUnread = false;
	double MaxFrameMs = 0.0;
};
