using UnrealBuildTool;

/// <summary>The engine's side: actor, component, Blueprint nodes, WebSocket, HTTP, meshes, textures.</summary>
public class Terraport : ModuleRules
{
    public Terraport(ReadOnlyTargetRules Target) : base(Target)
    {
        PCHUsage = PCHUsageMode.UseExplicitOrSharedPCHs;
        bUseUnity = false;
        bEnableExceptions = false;
        PublicDependencyModuleNames.AddRange(new[] { "Core", "CoreUObject", "Engine", "TerraportCore" });
        PrivateDependencyModuleNames.AddRange(new[] {
            "GeometryCore",
            "GeometryFramework",
            "HTTP",
            "ImageCore",
            "ImageWrapper",
            "ProceduralMeshComponent",
            "RHI",
            "RenderCore",
            "WebSockets",
        });
    }
}
