using UnrealBuildTool;

/// <summary>The scene's actor and components; below them, in Private/Core, protocol, decoder and stage in plain C++17.</summary>
public class Terraport : ModuleRules
{
    public Terraport(ReadOnlyTargetRules Target) : base(Target)
    {
        // The core must not see the engine's macros, and names in anonymous namespaces would meet in merged files.
        PCHUsage = PCHUsageMode.NoPCHs;
        bUseUnity = false;
        bEnableExceptions = false;
        PublicDependencyModuleNames.AddRange(new[] { "Core", "CoreUObject", "Engine" });
        PrivateDependencyModuleNames.AddRange(new[] {
            "HTTP",
            "ImageCore",
            "ImageWrapper",
            "ProceduralMeshComponent",
            "RHI",
            "RenderCore",
            "WebSockets",
        });
        AddEngineThirdPartyPrivateStaticDependencies(Target, "zlib");
    }
}
