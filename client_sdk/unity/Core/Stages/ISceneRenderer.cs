namespace Terraport
{
    /// <summary>
    /// What an engine does for a <see cref="SceneStage"/>: make meshes drawable ahead of time, and change what is drawn in one
    /// frame. Called from <see cref="SceneStage.Update"/>, <see cref="SceneStage.Show"/> and Dispose alone, on their thread.
    /// </summary>
    /// <remarks>
    /// An implementation throws <see cref="TerraportException"/> from Upload or IsDrawable where a mesh cannot be drawn (an
    /// image does not decode): the segment is freed, counts as missing, and its base stays. Anything else that it throws is its
    /// own mistake and passes through.
    /// </remarks>
    public interface ISceneRenderer
    {
        /// <summary>
        /// Make the base of <paramref name="files"/> drawable, not drawn yet, every face in its lists. Called again, the frame's
        /// budget being watched in between, until it returns true; another <paramref name="files"/> begins anew and gives up
        /// what was not finished. What is drawn of the version before stays until the swap with
        /// <see cref="SceneSwap.IsNewBase"/>.
        /// </summary>
        bool UploadBase(SceneFiles files);

        /// <summary>
        /// Write the list of faces that a block of the base will have if the next swap names it in
        /// <see cref="SceneSwap.ChangedBlocks"/>: faces with <c>next.Mask[face] == 1</c> are left out. Not drawn yet. Blocks are
        /// cut as <see cref="StageOptions.BaseBlockFaces"/> says; one may be prepared several times before a swap.
        /// </summary>
        void PrepareBase(FaceRange block, HiddenFaces next);

        /// <summary>
        /// Make a segment drawable, not drawn yet. Called again with the same segment in the next frame until it returns true: an
        /// image may come a frame after the geometry. The mesh is reused for another segment once it returned true.
        /// </summary>
        bool Upload(uint segment, SegmentMesh mesh);

        /// <summary>
        /// Whether an uploaded segment can be drawn without any further preparation; asked in every frame until it can.
        /// </summary>
        bool IsDrawable(uint segment);

        /// <summary>Let go of a segment that was uploaded, in whole or in part. It is not drawn.</summary>
        void Free(uint segment);

        /// <summary>
        /// Change what is drawn, all of it in the frame that is drawn next. Flags alone: nothing is uploaded here.
        /// </summary>
        void Swap(SceneSwap swap);
    }
}
