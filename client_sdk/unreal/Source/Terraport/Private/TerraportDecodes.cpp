#include "TerraportDecodes.h"

#include "Tasks/Task.h"
#include "TerraportMeshPart.h"

#include <deque>
#include <mutex>
#include <utility>
#include <vector>

struct FTerraportDecodes::FShared
{
	/** Buffers of one task, used again by the next. */
	struct FBuffers
	{
		terraport::SegmentDecoder Decoder;
		terraport::SegmentMesh Mesh;
		FTerraportMeshPart Part;
	};

	FShared(std::shared_ptr<terraport::DiskCache> InDisk, ETerraportVertexColours InColours, int32 InMaxTasks)
		: Disk(std::move(InDisk)), Colours(InColours), MaxTasks(InMaxTasks)
	{
	}

	const std::shared_ptr<terraport::DiskCache> Disk;
	const ETerraportVertexColours Colours;
	const int32 MaxTasks;
	/** For everything below. */
	std::mutex Mutex;
	std::deque<terraport::DecodeJob> Waiting;
	std::deque<terraport::DecodeResult> Done;
	std::vector<std::unique_ptr<FBuffers>> Spare;
	int32 Tasks = 0;
	bool bEnded = false;
};

FTerraportDecodes::FTerraportDecodes(
	std::shared_ptr<terraport::DiskCache> Disk, ETerraportVertexColours Colours, int32 MaxTasks)
	: Shared(MakeShared<FShared, ESPMode::ThreadSafe>(std::move(Disk), Colours, MaxTasks))
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
 * One task: job after job while there are any. `Shared` outlives the owner, which may be gone meanwhile.
 *
 * Invariant: as long as `Waiting` has a job, `Tasks` is above 0. A task gives up its place under the lock under which it saw
 * that nothing waits, so `push` cannot count on one that has left.
 */
void FTerraportDecodes::Work(const TSharedRef<FShared, ESPMode::ThreadSafe>& Shared)
{
	std::unique_ptr<FShared::FBuffers> Buffers;
	for (;;)
	{
		terraport::DecodeJob Job;
		{
			const std::lock_guard<std::mutex> Lock(Shared->Mutex);
			if (!Buffers && !Shared->Spare.empty())
			{
				Buffers = std::move(Shared->Spare.back());
				Shared->Spare.pop_back();
			}
			if (Shared->bEnded || Shared->Waiting.empty())
			{
				--Shared->Tasks;
				if (Buffers)
				{
					Shared->Spare.push_back(std::move(Buffers));
				}
				return;
			}
			Job = std::move(Shared->Waiting.front());
			Shared->Waiting.pop_front();
		}
		if (!Buffers)
		{
			Buffers = std::make_unique<FShared::FBuffers>();
		}
		const auto Prepare = [&Shared, &Buffers](const terraport::SegmentMesh& Mesh, terraport::ByteSpan Payload,
								 const terraport::Scene& Scene) -> std::unique_ptr<terraport::PreparedSegment> {
			auto Prepared = std::make_unique<FTerraportPreparedSegment>();
			Buffers->Part.Build(Mesh, Payload, Scene.regions, Shared->Colours, Prepared->Pixels, Prepared->bUnread);
			Prepared->Piece = MakeShared<FTerraportGroundPiece, ESPMode::ThreadSafe>(Buffers->Part);
			Prepared->gpuBytes = std::size_t(Prepared->Piece->GpuBytes()) + Mesh.image.gpuBytes();
			return Prepared;
		};
		// Without the lock: milliseconds, in which the game thread asks and takes.
		terraport::DecodeResult Result =
			terraport::runDecode(std::move(Job), *Shared->Disk, Buffers->Decoder, Buffers->Mesh, Prepare);
		const std::lock_guard<std::mutex> Lock(Shared->Mutex);
		if (!Shared->bEnded)
		{
			Shared->Done.push_back(std::move(Result));
		}
	}
}

bool FTerraportDecodes::tryPop(terraport::DecodeResult& Result)
{
	const std::lock_guard<std::mutex> Lock(Shared->Mutex);
	if (Shared->Done.empty())
	{
		return false;
	}
	Result = std::move(Shared->Done.front());
	Shared->Done.pop_front();
	return true;
}
