#include "TerraportDecodes.h"

#include "Tasks/Task.h"
#include "TerraportMeshBuilder.h"

#include <deque>
#include <mutex>
#include <utility>
#include <vector>

namespace
{
/** Buffers kept to be used again; more wait nowhere, since the stage bounds what is in flight. */
constexpr std::size_t MaxSpareMeshes = 16;
} // namespace

struct FTerraportDecodes::FShared
{
	FShared(
		TSharedRef<ITerraportMeshBackend, ESPMode::ThreadSafe> InBackend, ETerraportVertexColours InColours, int32 InMaxTasks)
		: Backend(InBackend), Colours(InColours), MaxTasks(InMaxTasks)
	{
	}

	const TSharedRef<ITerraportMeshBackend, ESPMode::ThreadSafe> Backend;
	const ETerraportVertexColours Colours;
	const int32 MaxTasks;
	/** For everything below: workers and the game thread read and write it. */
	std::mutex Mutex;
	std::deque<terraport::DecodeJob> Waiting;
	std::deque<terraport::DecodedSegment> Done;
	std::vector<std::unique_ptr<terraport::SegmentMesh>> Spare;
	int32 Tasks = 0;
	bool bEnded = false;
};

FTerraportDecodes::FTerraportDecodes(
	TSharedRef<ITerraportMeshBackend, ESPMode::ThreadSafe> Backend, ETerraportVertexColours Colours, int32 MaxTasks)
	: Shared(MakeShared<FShared, ESPMode::ThreadSafe>(Backend, Colours, MaxTasks))
{
}

FTerraportDecodes::~FTerraportDecodes()
{
	const std::lock_guard<std::mutex> Lock(Shared->Mutex);
	Shared->bEnded = true;
	Shared->Waiting.clear();
	Shared->Done.clear();
}

void FTerraportDecodes::push(terraport::DecodeJob Job)
{
	{
		const std::lock_guard<std::mutex> Lock(Shared->Mutex);
		Shared->Waiting.push_back(std::move(Job));
		if (Shared->Tasks >= Shared->MaxTasks)
		{
			return;
		}
		++Shared->Tasks;
	}
	UE::Tasks::Launch(TEXT("TerraportDecode"), [Kept = Shared]() { Work(Kept); }, UE::Tasks::ETaskPriority::BackgroundNormal);
}

/**
 * One task: job after job while there are any. On a worker thread; `Shared` outlives the owner, which may be gone meanwhile.
 *
 * Invariant: as long as `Waiting` has a job, `Tasks` is above 0. A task gives up its place under the lock under which it saw
 * that nothing waits, so `push` cannot count on one that has left.
 */
void FTerraportDecodes::Work(const TSharedRef<FShared, ESPMode::ThreadSafe>& Shared)
{
	for (;;)
	{
		// 1. The oldest job, and buffers of an earlier one.
		terraport::DecodeJob Job;
		terraport::DecodedSegment Answer;
		{
			const std::lock_guard<std::mutex> Lock(Shared->Mutex);
			if (Shared->bEnded || Shared->Waiting.empty())
			{
				--Shared->Tasks;
				return;
			}
			Job = std::move(Shared->Waiting.front());
			Shared->Waiting.pop_front();
			if (!Shared->Spare.empty())
			{
				Answer.mesh = std::move(Shared->Spare.back());
				Shared->Spare.pop_back();
			}
		}
		// 2. Decode, without the lock: milliseconds, in which the game thread asks and takes.
		if (!Answer.mesh)
		{
			Answer.mesh = std::make_unique<terraport::SegmentMesh>();
		}
		Answer.segment = Job.segment;
		Answer.epoch = Job.epoch;
		Answer.payload = Job.payload;
		Answer.status = terraport::decodePayload(Job, *Answer.mesh);
		if (Answer.status.isOk())
		{
			if (!Answer.mesh->engineData)
			{
				Answer.mesh->engineData = std::make_unique<FTerraportSegmentData>();
			}
			FTerraportSegmentData& Data = static_cast<FTerraportSegmentData&>(*Answer.mesh->engineData);
			static const std::vector<terraport::RegionFacts> NoRegions;
			Data.Build(*Answer.mesh, terraport::viewOf(*Job.payload), *Shared->Backend, Shared->Colours,
				Job.files ? Job.files->regions : NoRegions);
		}
		// 3. Hand over; buffers of what failed are used again at once.
		const std::lock_guard<std::mutex> Lock(Shared->Mutex);
		if (!Answer.status.isOk())
		{
			Shared->Spare.push_back(std::move(Answer.mesh));
		}
		if (!Shared->bEnded)
		{
			Shared->Done.push_back(std::move(Answer));
		}
	}
}

bool FTerraportDecodes::tryPop(terraport::DecodedSegment& Out)
{
	const std::lock_guard<std::mutex> Lock(Shared->Mutex);
	if (Shared->Done.empty())
	{
		return false;
	}
	Out = std::move(Shared->Done.front());
	Shared->Done.pop_front();
	return true;
}

void FTerraportDecodes::release(std::unique_ptr<terraport::SegmentMesh> Mesh)
{
	if (!Mesh)
	{
		return;
	}
	if (Mesh->engineData)
	{
		// What was not uploaded after all.
		FTerraportSegmentData& Data = static_cast<FTerraportSegmentData&>(*Mesh->engineData);
		Data.Prepared.Reset();
		Data.Ground.reset();
		Data.Pixels = FTerraportPixels();
	}
	const std::lock_guard<std::mutex> Lock(Shared->Mutex);
	if (Shared->Spare.size() < MaxSpareMeshes)
	{
		Shared->Spare.push_back(std::move(Mesh));
	}
}
