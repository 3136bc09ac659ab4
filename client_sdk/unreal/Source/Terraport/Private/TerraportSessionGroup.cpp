#include "TerraportSession.h"

#include "HAL/PlatformTime.h"

#include <optional>
#include <utility>

// A session's part in groups, for UTerraportGroupComponent.

namespace
{
/** Events of a group that wait for its component; where nobody takes them the older ones go. */
constexpr std::size_t MaxGroupNews = 64;
} // namespace

bool FTerraportSession::Gather(const terraport::Vec3& Position, double RadiusM)
{
	return Stream && Stream->gather(Position, RadiusM, std::nullopt, std::nullopt).isOk();
}

int64 FTerraportSession::GoToGroup()
{
	return Follower ? Follower->goThere(FPlatformTime::Seconds() * 1000.0) : 0;
}

std::vector<terraport::StreamEvent> FTerraportSession::TakeGroupNews()
{
	return std::exchange(GroupNews, {});
}

void FTerraportSession::NoteGroup(const terraport::StreamEvent& Event)
{
	if (Event.kind < terraport::EventKind::GroupJoined || Event.kind > terraport::EventKind::GroupRefused)
	{
		return;
	}
	Follower->handle(Event, FPlatformTime::Seconds() * 1000.0);
	if (GroupNews.size() >= MaxGroupNews)
	{
		GroupNews.erase(GroupNews.begin());
	}
	GroupNews.push_back(Event);
}
