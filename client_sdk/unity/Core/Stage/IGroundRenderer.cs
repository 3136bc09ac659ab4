using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// What an engine does for a <see cref="SceneClient"/>. Everything but the two Prepare methods is called on the thread that draws; nothing
    /// that was uploaded is drawn before a swap.
    /// </summary>
    internal interface IGroundRenderer
    {
        /// <summary>Make a decoded mesh ready to be uploaded; on any thread. The mesh is used again afterwards.</summary>
        object Prepare(SegmentMesh mesh);

        /// <summary>Make a base ready to be uploaded; on any thread.</summary>
        object PrepareBase(SceneFiles files);

        /// <summary>Take a prepared mesh back unused; on any thread.</summary>
        void Discard(object prepared);

        /// <summary>Upload one more slice of a base; true once all of it can be drawn.</summary>
        bool UploadBase(SceneFiles files);

        /// <summary>Upload a segment, hidden.</summary>
        /// <exception cref="TerraportException">It cannot be drawn here.</exception>
        void Upload(ulong key, object prepared);

        /// <summary>Whether an uploaded segment can be drawn: its image may take some frames more.</summary>
        /// <exception cref="TerraportException">It cannot be drawn here.</exception>
        bool IsDrawable(ulong key);

        /// <summary>Let go of a segment that is not drawn.</summary>
        void Free(ulong key);

        /// <summary>Prepare one more slice of the base without some faces (one bit each); true once a swap can show it.</summary>
        bool PrepareHidden(byte[] hidden);

        /// <summary>
        /// Draw exactly these segments from this frame on, and the base as it was prepared; with <paramref name="isNewBase"/> the base that was
        /// uploaded last takes the place of the one that is drawn. Sets flags only.
        /// </summary>
        void Swap(bool isNewBase, HashSet<ulong> shown);
    }
}
