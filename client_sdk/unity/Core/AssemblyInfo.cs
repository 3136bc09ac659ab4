using System.Runtime.CompilerServices;

// The public API of the core is what users of the components need; these assemblies see the rest, the last two in tests.
[assembly:InternalsVisibleTo("Terraport.Runtime")]
[assembly:InternalsVisibleTo("Terraport.Editor")]
[assembly:InternalsVisibleTo("terraport-tools")]
[assembly:InternalsVisibleTo("SceneOnStubs")]
