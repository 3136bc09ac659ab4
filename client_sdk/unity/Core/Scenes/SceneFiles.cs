using System.Collections.Generic;

namespace Terraport
{
    /// <summary>Everything that is loaded once for a version of a scene.</summary>
    public sealed class SceneFiles
    {
        /// <summary>Files of one and the same version, as <see cref="SceneLoader"/> checks them.</summary>
        public SceneFiles(SceneManifest manifest, SegmentMesh baseMesh, Cover cover, IReadOnlyList<RegionFacts> regions,
            IReadOnlyList<RegionUnion> unions)
        {
            Manifest = manifest;
            Base = baseMesh;
            Cover = cover;
            Regions = regions;
            Unions = unions;
        }

        /// <summary>What scene.json says of this version.</summary>
        public SceneManifest Manifest { get; private set; }

        /// <summary>The base mesh of the whole scene; shared, not copied: who draws it must not change it.</summary>
        public SegmentMesh Base { get; private set; }

        /// <summary>Segments over each base face.</summary>
        public Cover Cover { get; private set; }

        /// <summary>Facts about the regions; the position is the region id.</summary>
        public IReadOnlyList<RegionFacts> Regions { get; private set; }

        /// <summary>How regions unite to coarser pieces; empty where the scene does not say.</summary>
        public IReadOnlyList<RegionUnion> Unions { get; private set; }
    }
}
