using System.Runtime.CompilerServices;

[assembly:InternalsVisibleTo("SceneOnStubs")]
