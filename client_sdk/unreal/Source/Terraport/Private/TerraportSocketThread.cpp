#include "TerraportSocketThread.h"

#include "CoreMinimal.h"
#include "Misc/ConfigCacheIni.h"
#include "Modules/ModuleManager.h"
#include "TerraportLog.h"

namespace
{
/** What the engine takes where nothing is set; its BaseEngine.ini says 0.0333. */
constexpr double EngineFrameTimeS = 1.0 / 30.0;
constexpr double EngineToleranceS = 0.0005;
/** From here on a landing is held up: 6 MB/s and less. */
constexpr double SlowS = 0.005;

constexpr const TCHAR* Section = TEXT("WebSockets.LibWebSockets");
constexpr const TCHAR* FrameTimeKey = TEXT("ThreadTargetFrameTimeInSeconds");

double Setting(const TCHAR* Key, double Default)
{
	double Value = Default;
	GConfig->GetDouble(Section, Key, Value, GEngineIni);
	return Value;
}
} // namespace

void TerraportSocketThread::Prepare()
{
	if (GConfig == nullptr)
	{
		return;
	}
	const bool bIsTooLate = FModuleManager::Get().IsModuleLoaded(TEXT("WebSockets"));
	// The engine's own setting and a project's are not told apart but by their value: another one was meant by somebody.
	const bool bIsEngines = FMath::Abs(Setting(FrameTimeKey, EngineFrameTimeS) - EngineFrameTimeS) < EngineToleranceS;
	if (!bIsTooLate && bIsEngines)
	{
		GConfig->SetDouble(Section, FrameTimeKey, FrameTimeS, GEngineIni);
	}
	const double PaceS =
		FMath::Max(Setting(FrameTimeKey, EngineFrameTimeS), Setting(TEXT("ThreadMinimumSleepTimeInSeconds"), 0.0));
	// Newer engines can wait for the sockets instead, and do where this is off: then there is no pace.
	bool bPolls = true;
	GConfig->GetBool(Section, TEXT("bPollService"), bPolls, GEngineIni);
	if (bPolls && PaceS > SlowS)
	{
		UE_LOG(LogTerraport, Warning,
			TEXT("%s: its thread looks at its sockets every %.1f ms, and landings may take seconds. Write into "
				 "DefaultEngine.ini: "
				 "[WebSockets.LibWebSockets] ThreadTargetFrameTimeInSeconds=%.3f"),
			bIsTooLate ? TEXT("the WebSockets module was loaded before terraport could set its pace")
					   : TEXT("the WebSockets module is configured to be slow"),
			PaceS * 1000.0, FrameTimeS);
	}
}
