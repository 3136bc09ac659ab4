using System.Runtime.CompilerServices;

// The core's public API is what users of the components need; the rest is for these.
[assembly:InternalsVisibleTo("Terraport.Runtime")]
[assembly:InternalsVisibleTo("Terraport.Editor")]
[assembly:InternalsVisibleTo("Terraport.Tests")]
[assembly:InternalsVisibleTo("terraport-tools")]
[assembly:InternalsVisibleTo("SceneOnStubs")]
