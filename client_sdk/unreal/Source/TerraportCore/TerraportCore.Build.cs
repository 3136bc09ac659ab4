using UnrealBuildTool;

/// <summary>
/// Protocol, session, decoders and stage in plain C++17: no engine type, no exception, no library but zlib. The same files
/// are compiled and tested outside the engine by CMakeLists.txt.
/// </summary>
public class TerraportCore : ModuleRules
{
    public TerraportCore(ReadOnlyTargetRules Target) : base(Target)
    {
        PCHUsage = PCHUsageMode.NoPCHs;
        // Names in anonymous namespaces would meet in merged files.
        bUseUnity = false;
        bEnableExceptions = false;
        bUseRTTI = false;
        // For IMPLEMENT_MODULE alone.
        PrivateDependencyModuleNames.Add("Core");
        AddEngineThirdPartyPrivateStaticDependencies(Target, "zlib");
        PrivateDefinitions.Add("TERRAPORT_UNREAL=1");
    }
}
