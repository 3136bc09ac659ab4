using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>What changes in the one frame in which a landing is shown.</summary>
    public sealed class SceneSwap
    {
        /// <summary>Landing that is shown from now on; 0 where a base comes without one.</summary>
        public int Landing { get; internal set; }

        /// <summary>It is the inner part of the landing, after its deadline; the rest comes in another swap.</summary>
        public bool IsDegraded { get; internal set; }

        /// <summary>
        /// The base that <see cref="ISceneRenderer.UploadBase"/> made is drawn from now on, whole, in place of the one before.
        /// </summary>
        public bool IsNewBase { get; internal set; }

        /// <summary>Segments to be drawn from now on that were not, ascending. All were uploaded and drawable before.</summary>
        public IReadOnlyList<uint> Shown { get; internal set; } = Array.Empty<uint>();

        /// <summary>
        /// Segments not to be drawn any more, ascending; of the version before where the base is new. They are freed
        /// later.
        /// </summary>
        public IReadOnlyList<uint> Hidden { get; internal set; } = Array.Empty<uint>();

        /// <summary>
        /// Blocks of the base whose prepared list of faces is drawn from now on; every other keeps the drawn one.
        /// </summary>
        public IReadOnlyList<FaceRange> ChangedBlocks { get; internal set; } = Array.Empty<FaceRange>();

        /// <summary>Faces of the base that are hidden after the swap.</summary>
        public HiddenFaces BaseHidden { get; internal set; }
    }
}
