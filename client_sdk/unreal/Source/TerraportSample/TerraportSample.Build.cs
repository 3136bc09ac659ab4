using UnrealBuildTool;

/// <summary>A pawn that teleports: what docs/how-to/unreal.md builds by Blueprint, in C++.</summary>
public class TerraportSample : ModuleRules
{
	public TerraportSample(ReadOnlyTargetRules Target) : base(Target)
	{
		PCHUsage = PCHUsageMode.UseExplicitOrSharedPCHs;
		PublicDependencyModuleNames.AddRange(new[] { "Core", "CoreUObject", "Engine", "InputCore", "Terraport" });
		PrivateDependencyModuleNames.AddRange(new[] { "HeadMountedDisplay" });
	}
}
