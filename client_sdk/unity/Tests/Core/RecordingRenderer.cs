using System;
using System.Collections.Generic;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>
    /// A renderer that draws nothing and holds the stage to its promises: segments are uploaded, drawable, shown, hidden, freed in
    /// that order; a block of the base that changes was prepared; the base's lists hide what the stage says.
    /// </summary>
    internal sealed class RecordingRenderer : ISceneRenderer
    {
        // Calls of Upload by segment, as long as it is not freed; complete: those that returned true.
        private readonly Dictionary<uint, int> calls = new Dictionary<uint, int>();
        private readonly HashSet<uint> complete = new HashSet<uint>();
        private byte[] prepared;
        private bool[] isPrepared;
        private int baseCalls;

        /// <summary>Calls of Upload that one segment takes.</summary>
        internal int CallsPerUpload = 1;

        /// <summary>Frames from the end of an upload until the segment can be drawn.</summary>
        internal int FramesToWarm;

        /// <summary>Segments whose upload fails.</summary>
        internal readonly HashSet<uint> Unusable = new HashSet<uint>();

        /// <summary>Segments of which it is noticed only after their upload that they cannot be drawn.</summary>
        internal readonly HashSet<uint> UnusableLater = new HashSet<uint>();

        /// <summary>A clock that every call moves on, milliseconds.</summary>
        internal double NowMs;

        /// <summary>Milliseconds that one call of Upload takes.</summary>
        internal double UploadMs;

        internal readonly HashSet<uint> Shown = new HashSet<uint>();
        internal readonly List<SceneSwap> Swaps = new List<SceneSwap>();
        private readonly Dictionary<uint, int> warming = new Dictionary<uint, int>();

        /// <summary>What the drawn lists of the base leave out.</summary>
        internal byte[] Drawn { get; private set; }

        internal int UploadCalls { get; private set; }

        internal int Uploaded => calls.Count;

        /// <summary>Faces of a block, as the stage's options say.</summary>
        internal int BlockFaces = 16;

        public bool UploadBase(SceneFiles files)
        {
            baseCalls++;
            // Two calls more than one: a base takes several frames.
            if (baseCalls % 3 != 0)
            {
                return false;
            }
            prepared = new byte[files.Cover.Offsets.Length - 1];
            isPrepared = new bool[prepared.Length];
            return true;
        }

        public void PrepareBase(FaceRange block, HiddenFaces next)
        {
            Assert.AreEqual(0, block.First % BlockFaces);
            Assert.LessOrEqual(block.Count, BlockFaces);
            Array.Copy(next.Mask, block.First, prepared, block.First, block.Count);
            isPrepared[block.First] = true;
        }

        public bool Upload(uint segment, SegmentMesh mesh)
        {
            Assert.Greater(mesh.VertexCount, 0, "an empty mesh");
            Assert.IsFalse(complete.Contains(segment), "uploaded twice");
            UploadCalls++;
            NowMs += UploadMs;
            int count;
            calls.TryGetValue(segment, out count);
            calls[segment] = count + 1;
            if (Unusable.Contains(segment))
            {
                throw new TerraportException("damaged", "image does not decode");
            }
            if (count + 1 < CallsPerUpload)
            {
                return false;
            }
            complete.Add(segment);
            warming[segment] = FramesToWarm;
            return true;
        }

        public bool IsDrawable(uint segment)
        {
            Assert.IsTrue(complete.Contains(segment), "asked for a segment that was not uploaded");
            if (UnusableLater.Contains(segment))
            {
                throw new TerraportException("damaged", "image does not decode");
            }
            // Counted down by the stage's own questions, one a frame.
            return warming[segment]-- <= 0;
        }

        public void Free(uint segment)
        {
            Assert.IsFalse(Shown.Contains(segment), "freed while it is drawn");
            Assert.IsTrue(calls.Remove(segment), "freed without having been uploaded");
            complete.Remove(segment);
        }

        public void Swap(SceneSwap swap)
        {
            foreach (uint segment in swap.Hidden)
            {
                Assert.IsTrue(Shown.Remove(segment), "hidden without having been shown");
            }
            foreach (uint segment in swap.Shown)
            {
                Assert.IsTrue(complete.Contains(segment) && warming[segment] < 0, "shown before it can be drawn");
                Assert.IsTrue(Shown.Add(segment), "shown twice");
            }
            if (swap.IsNewBase)
            {
                Drawn = new byte[prepared.Length];
            }
            foreach (FaceRange block in swap.ChangedBlocks)
            {
                Assert.IsTrue(isPrepared[block.First], "a block changes that was not prepared");
                for (int face = block.First; face < block.End; face++)
                {
                    // Two lists a block: the one that was drawn is the other one from now on.
                    byte before = Drawn[face];
                    Drawn[face] = prepared[face];
                    prepared[face] = before;
                }
                isPrepared[block.First] = false;
            }
            Assert.IsTrue(Covers.IsSame(Drawn, swap.BaseHidden.Mask), "the drawn lists hide other faces than the stage says");
            Swaps.Add(swap);
        }
    }
}
