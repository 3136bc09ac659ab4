using System;
using Terraport.Unity;
using UnityEngine;

namespace Terraport.Stubs
{
    /// <summary>The coarser level in a ring around full detail: there by itself, and gone with a switch.</summary>
    public static partial class SceneOnStubs
    {
        private static void SwitchRing(Vec3 place, float radiusM)
        {
            bool hasRing = scene.Files.Manifest.Levels > 1;
            uint segments = (uint)scene.Files.Manifest.SegmentCount;
            // From elsewhere, so that the swap shows all that is there.
            Land(new Vec3(place.X + radiusM, place.Y, place.Z), radiusM);
            Land(place, radiusM);
            if (Faults.Count > 0) return;
            Expect(hasRing ? (long)(3 * radiusM) : 0, (long)(plan.CoarseRadiusM ?? 0), "metres that the ring reaches");
            Expect((long)radiusM, (long)plan.EffectiveRadiusM, "metres that full detail reaches");
            long withRing = scene.Figures.DrawnTriangles;
            int hidden = lastSwap.BaseHidden.Count;
            if (hasRing)
            {
                GroundHit ground;
                bool isMet = scene.GroundAt(scene.ToWorld(new Vec3(place.X + 2 * radiusM, place.Y + 100, place.Z)), out ground);
                Expect(1, isMet && ground.Segment.HasValue && ground.Segment.Value < segments ? 1 : 0,
                    "segments that the ring's ground tells");
            }
            scene.ShowsCoarse = false;
            Land(place, radiusM);
            Expect(0, (long)(plan.CoarseRadiusM ?? 0), "metres of a ring that nobody wants");
            Expect(hasRing ? 1 : 0, lastSwap.BaseHidden.Count < hidden ? 1 : 0, "bases that came back where the ring was");
            Expect(hasRing ? 1 : 0, scene.Figures.DrawnTriangles != withRing ? 1 : 0, "other triangles without the ring");
            foreach (uint id in lastSwap.Hidden) Expect(1, id >= segments ? 1 : 0, "segments hidden that are no ring's");
            Expect(hasRing ? 1 : 0, lastSwap.Hidden.Count > 0 ? 1 : 0, "rings that were hidden");
            scene.ShowsCoarse = true;
        }
    }
}
