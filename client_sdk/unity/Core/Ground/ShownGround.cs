using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// The ground that is shown, for rays and feet: detail where it is shown, the base elsewhere, no hidden face of it. It changes in the
    /// frame of a swap and at no other time.
    /// </summary>
    internal sealed class ShownGround
    {
        // A ray that meets nothing sooner ends here: farther than any scene.
        private const double FarM = 1e8;

        private static readonly byte[] NoneHidden = Array.Empty<byte>();

        private readonly List<KeyValuePair<uint, GroundMesh>> detail = new List<KeyValuePair<uint, GroundMesh>>();
        private GroundMesh baseMesh;
        private byte[] hidden = NoneHidden;

        /// <summary>How often what is shown has changed.</summary>
        internal int Changes { get; private set; }

        /// <summary>Show something else.</summary>
        /// <param name="ofBase">The base.</param>
        /// <param name="hiddenFaces">Its hidden faces, one bit each; empty for none.</param>
        /// <param name="segments">Ids and meshes of the detail.</param>
        internal void Show(GroundMesh ofBase, byte[] hiddenFaces, IEnumerable<KeyValuePair<uint, GroundMesh>> segments)
        {
            baseMesh = ofBase;
            hidden = hiddenFaces;
            detail.Clear();
            detail.AddRange(segments);
            Changes++;
        }

        /// <summary>Find the first point along a ray; false where there is none.</summary>
        /// <param name="origin">Metres, scene frame.</param>
        /// <param name="direction">Of any length but 0.</param>
        /// <param name="mostAt">How far, in lengths of the direction.</param>
        /// <param name="point">What was met.</param>
        internal bool Cast(Vec3 origin, Vec3 direction, double mostAt, out GroundPoint point)
        {
            point = new GroundPoint { At = mostAt };
            bool isMet = baseMesh != null && baseMesh.Cast(origin, direction, hidden, ref point);
            foreach (KeyValuePair<uint, GroundMesh> segment in detail)
            {
                if (!segment.Value.Cast(origin, direction, NoneHidden, ref point)) continue;
                point.Segment = segment.Key;
                isMet = true;
            }
            return isMet;
        }

        /// <summary>Find the ground on the vertical through a point: the highest not above it, else the lowest above it.</summary>
        internal bool At(Vec3 position, out GroundPoint point)
        {
            return Cast(position, new Vec3(0, -1, 0), FarM, out point) || Cast(position, new Vec3(0, 1, 0), FarM, out point);
        }

        /// <summary>
        /// Gather faces around a place, to be made solid: those whose box meets a cube. Where they are too many the cube is halved, four times
        /// at most.
        /// </summary>
        /// <param name="centre">Metres, scene frame.</param>
        /// <param name="halfM">Half the side of the cube, metres.</param>
        /// <param name="mostFaces">Faces at most.</param>
        /// <param name="corners">Takes three corners for each face, counter-clockwise from outside, scene frame.</param>
        /// <returns>Half the side of the cube of which all faces are there; 0 where that was none.</returns>
        internal double Gather(Vec3 centre, double halfM, int mostFaces, List<float> corners)
        {
            for (int halving = 0; halving <= 4; halving++, halfM /= 2)
            {
                corners.Clear();
                bool isWhole = baseMesh == null || baseMesh.Gather(centre, halfM, hidden, mostFaces * 9, corners);
                foreach (KeyValuePair<uint, GroundMesh> segment in detail)
                {
                    isWhole = isWhole && segment.Value.Gather(centre, halfM, NoneHidden, mostFaces * 9, corners);
                }
                if (isWhole) return halfM;
            }
            corners.Clear();
            return 0;
        }
    }
}
