using System;
using System.Collections.Generic;
using System.Globalization;

namespace Terraport
{
    /// <summary>Named regions as places to go to, and the coarser pieces that a region is part of (scene format, section 11.1).</summary>
    public static class Places
    {
        /// <summary>Of a landing where the scene says none, metres.</summary>
        private const double DefaultRadiusM = 60;

        /// <summary>
        /// The named regions: by name whatever its case, the largest of each name first. Regions of which the scene does not say where they
        /// are are left out.
        /// </summary>
        public static List<Place> Of(IReadOnlyList<RegionFacts> regions)
        {
            List<Place> places = new List<Place>();
            for (int at = 0; at < regions.Count; at++)
            {
                RegionFacts region = regions[at];
                RegionPlace view = region.Place;
                if (region.Label == null || (view == null && region.Centroid == null))
                {
                    continue;
                }
                places.Add(new Place {
                    Label = region.Label,
                    StableId = region.StableId,
                    Region = region.Id,
                    AreaM2 = region.AreaM2,
                    Position = view != null ? view.Position : region.Centroid.Value,
                    HeadingDeg = view != null ? view.HeadingDeg : (double?)null,
                    RadiusM = view != null ? view.RadiusM : DefaultRadiusM,
                    IsView = view != null,
                });
            }
            places.Sort(Compare);
            return places;
        }

        /// <summary>
        /// The place of that name, whatever its case, or of that stable id in digits; of several the first. Null where there is none.
        /// </summary>
        public static Place Find(IReadOnlyList<Place> places, string wanted)
        {
            string text = (wanted ?? "").Trim();
            foreach (Place place in places)
            {
                if (string.Equals(place.Label, text, StringComparison.OrdinalIgnoreCase))
                {
                    return place;
                }
            }
            foreach (Place place in places)
            {
                if (place.StableId != null && place.StableId.Value.ToString(CultureInfo.InvariantCulture) == text)
                {
                    return place;
                }
            }
            return null;
        }

        /// <summary>
        /// The pieces that a region is part of, finest first: one for each cost at which more is united, each holding those before. Empty for
        /// a region that is not there.
        /// </summary>
        public static List<CoarserPiece> Coarser(SceneFiles files, int region)
        {
            IReadOnlyList<RegionFacts> regions = files.Regions;
            IReadOnlyList<RegionUnion> unions = files.Unions;
            List<CoarserPiece> pieces = new List<CoarserPiece>();
            if (region < 0 || region >= regions.Count)
            {
                return pieces;
            }
            // 1. Up from the region: the unions that it takes part in, the last of each cost.
            List<int> found = new List<int>();
            int at = region;
            for (int place = 0; place < unions.Count; place++)
            {
                if (unions[place].One != at && unions[place].Other != at)
                {
                    continue;
                }
                at = regions.Count + place;
                if (found.Count > 0 && unions[found[found.Count - 1]].Cost == unions[place].Cost)
                {
                    found.RemoveAt(found.Count - 1);
                }
                found.Add(place);
            }
            // 2. Down from each to its regions.
            foreach (int place in found)
            {
                pieces.Add(PieceOf(regions, unions[place].Cost, MembersOf(regions.Count, unions, place)));
            }
            return pieces;
        }

        private static List<int> MembersOf(int regionCount, IReadOnlyList<RegionUnion> unions, int place)
        {
            List<int> members = new List<int>();
            // A piece that two unions name counts once: a reader bounds nothing else of the list.
            HashSet<int> seen = new HashSet<int>();
            Stack<int> open = new Stack<int>();
            open.Push(regionCount + place);
            while (open.Count > 0)
            {
                int piece = open.Pop();
                if (!seen.Add(piece))
                {
                    continue;
                }
                if (piece < regionCount)
                {
                    members.Add(piece);
                    continue;
                }
                open.Push(unions[piece - regionCount].One);
                open.Push(unions[piece - regionCount].Other);
            }
            members.Sort();
            return members;
        }

        private static CoarserPiece PieceOf(IReadOnlyList<RegionFacts> regions, double cost, List<int> members)
        {
            double areaM2 = 0;
            Dictionary<string, double> areaOfName = new Dictionary<string, double>();
            foreach (int member in members)
            {
                double area = regions[member].AreaM2 ?? 0;
                areaM2 += area;
                string label = regions[member].Label;
                if (label != null)
                {
                    double before;
                    areaOfName.TryGetValue(label, out before);
                    areaOfName[label] = before + area;
                }
            }
            string largest = null;
            foreach (KeyValuePair<string, double> entry in areaOfName)
            {
                // Of equal areas the last by name, as in the other clients.
                if (largest == null || entry.Value > areaOfName[largest]
                    || (entry.Value == areaOfName[largest] && string.CompareOrdinal(entry.Key, largest) > 0))
                {
                    largest = entry.Key;
                }
            }
            return new CoarserPiece { Cost = cost, Regions = members, AreaM2 = areaM2, Label = largest };
        }

        private static int Compare(Place a, Place b)
        {
            int byName = string.Compare(a.Label, b.Label, StringComparison.OrdinalIgnoreCase);
            int byArea = (b.AreaM2 ?? 0).CompareTo(a.AreaM2 ?? 0);
            return byName != 0 ? byName : byArea != 0 ? byArea : a.Region.CompareTo(b.Region);
        }
    }
}
