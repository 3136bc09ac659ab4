using System.Collections.Generic;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>Named regions as places to go to, and what a pick's region is part of.</summary>
    public sealed partial class TerraportScene
    {
        private static readonly List<Place> NoPlaces = new List<Place>();
        private static readonly List<CoarserPiece> NoPieces = new List<CoarserPiece>();

        /// <summary>The named regions, by name, the largest of each name first; empty before the scene is loaded. Made at each call.</summary>
        public IReadOnlyList<Place> ListPlaces() { return Files == null ? NoPlaces : Places.Of(Files.Regions); }

        /// <summary>The place of that name, whatever its case; of several the largest, null where there is none.</summary>
        public Place FindPlace(string label) { return Places.Find(ListPlaces(), label); }

        /// <summary>Where a place is in Unity's world.</summary>
        public Vector3 ToWorld(Place place) { return ToWorld(place.Position); }

        /// <summary>
        /// Coarser pieces that a region is part of, finest first: what the region of a <see cref="PickHit"/> lies in. Empty where the scene
        /// says nothing of it.
        /// </summary>
        public IReadOnlyList<CoarserPiece> CoarserPieces(int region) { return Files == null ? NoPieces : Places.Coarser(Files, region); }
    }
}
