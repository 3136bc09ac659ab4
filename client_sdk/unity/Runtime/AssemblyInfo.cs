using System.Runtime.CompilerServices;

// A test.
[assembly:InternalsVisibleTo("SceneOnStubs")]
