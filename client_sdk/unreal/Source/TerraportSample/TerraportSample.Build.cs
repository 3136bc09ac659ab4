using UnrealBuildTool;

/// <summary>A pawn that teleports: what docs/how-to/unreal.md builds by Blueprint, in C++.</summary>
public class TerraportSample : ModuleRules
{
    public TerraportSample(ReadOnlyTargetRules Target) : base(Target)
    {
        PCHUsage = PCHUsageMode.UseExplicitOrSharedPCHs;
        PublicDependencyModuleNames.AddRange(new[] { "Core", "CoreUObject", "Engine", "InputCore", "Terraport" });
        // Motion controllers: UE 5.3 moved them from a module of the engine to a plugin.
        bool bHasXrBase = Target.Version.MajorVersion > 5 || (Target.Version.MajorVersion == 5 && Target.Version.MinorVersion >= 3);
        PrivateDependencyModuleNames.Add(bHasXrBase ? "XRBase" : "HeadMountedDisplay");
    }
}
