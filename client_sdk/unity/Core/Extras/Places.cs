using System;
using System.Collections.Generic;
using System.Globalization;
using System.Linq;

namespace Terraport
{
    /// <summary>A region with a name, and where to stand to see it.</summary>
    public sealed class Place
    {
        /// <summary>What people call it; several regions may have one name.</summary>
        public string Label { get; internal set; }

        /// <summary>Number of the region, the same in every version.</summary>
        public long? StableId { get; internal set; }

        /// <summary>Number of the region in this version, as picks have it.</summary>
        public int Region { get; internal set; }

        /// <summary>True area, square metres.</summary>
        public double? AreaM2 { get; internal set; }

        /// <summary>Metres, scene frame: on the ground where <see cref="IsView"/>, else the middle of the region.</summary>
        public Vec3 Position { get; internal set; }

        /// <summary>Where to look, degrees clockwise from north; null where that was not chosen.</summary>
        public double? HeadingDeg { get; internal set; }

        /// <summary>Radius of a landing that shows the region, metres.</summary>
        public double RadiusM { get; internal set; }

        /// <summary>Whether the position was chosen for its view.</summary>
        public bool IsView { get; internal set; }
    }

    /// <summary>A coarser piece that a region is part of.</summary>
    public sealed class CoarserPiece
    {
        /// <summary>What uniting it costs: larger for coarser pieces.</summary>
        public double Cost { get; internal set; }

        /// <summary>Ids of its regions, ascending.</summary>
        public IReadOnlyList<int> Regions { get; internal set; }

        /// <summary>True area, square metres.</summary>
        public double AreaM2 { get; internal set; }

        /// <summary>The label that most of its area has; null without any.</summary>
        public string Label { get; internal set; }
    }

    /// <summary>Named regions as places to go to, and the coarser pieces that a region is part of (scene format, section 11.1).</summary>
    internal static class Places
    {
        /// <summary>Radius of a landing where the scene names none, metres.</summary>
        private const double DefaultRadiusM = 60;

        /// <summary>Return the named regions, by name whatever its case, the largest of each name first.</summary>
        internal static List<Place> Of(Regions regions)
        {
            return regions.List.Where(region => region.Label != null && (region.ViewPosition ?? region.Centroid) != null)
                .Select(region => new Place {
                    Label = region.Label,
                    StableId = region.StableId,
                    Region = region.Id,
                    AreaM2 = region.AreaM2,
                    Position = (region.ViewPosition ?? region.Centroid).Value,
                    HeadingDeg = region.ViewHeadingDeg,
                    RadiusM = region.ViewRadiusM ?? DefaultRadiusM,
                    IsView = region.ViewPosition != null,
                })
                .OrderBy(place => place.Label, StringComparer.OrdinalIgnoreCase)
                .ThenByDescending(place => place.AreaM2 ?? 0)
                .ThenBy(place => place.Region)
                .ToList();
        }

        /// <summary>Return the first place of that name, whatever its case, or of that stable id in digits; null where there is none.</summary>
        internal static Place Find(IReadOnlyList<Place> places, string wanted)
        {
            string text = (wanted ?? "").Trim();
            return places.FirstOrDefault(place => string.Equals(place.Label, text, StringComparison.OrdinalIgnoreCase))
                ?? places.FirstOrDefault(place => place.StableId?.ToString(CultureInfo.InvariantCulture) == text);
        }

        /// <summary>Return the pieces that a region is part of, finest first: one for each cost at which more is united.</summary>
        internal static List<CoarserPiece> Coarser(Regions regions, int region)
        {
            // 1. Up from the region: the unions that it takes part in, the last of each cost.
            var found = new List<int>();
            int piece = region;
            for (int union = 0; region >= 0 && region < regions.List.Count && union < regions.Unions.Count; union ++)
            {
                if (regions.Unions[union].One != piece && regions.Unions[union].Other != piece) continue;
                piece = regions.List.Count + union;
                if (found.Count > 0 && regions.Unions[found.Last()].Cost == regions.Unions[union].Cost) found.RemoveAt(found.Count - 1);
                found.Add(union);
            }
            // 2. Down from each to its regions.
            return found.Select(union => PieceOf(regions, union)).ToList();
        }

        private static CoarserPiece PieceOf(Regions regions, int union)
        {
            List<Region> members = MembersOf(regions, union);
            // Of equal areas the last by name, as in the other clients.
            IGrouping<string, Region> largest = members.Where(region => region.Label != null)
                                                    .GroupBy(region => region.Label)
                                                    .OrderBy(group => group.Sum(region => region.AreaM2 ?? 0))
                                                    .ThenBy(group => group.Key, StringComparer.Ordinal)
                                                    .LastOrDefault();
            return new CoarserPiece {
                Cost = regions.Unions[union].Cost,
                Regions = members.Select(region => region.Id).ToArray(),
                AreaM2 = members.Sum(region => region.AreaM2 ?? 0),
                Label = largest?.Key,
            };
        }

        private static List<Region> MembersOf(Regions regions, int union)
        {
            // A piece that two unions name counts once: nothing else bounds the list.
            var seen = new HashSet<int>();
            var open = new Stack<int>();
            open.Push(regions.List.Count + union);
            while (open.Count > 0)
            {
                int piece = open.Pop();
                if (!seen.Add(piece) || piece < regions.List.Count) continue;
                open.Push(regions.Unions[piece - regions.List.Count].One);
                open.Push(regions.Unions[piece - regions.List.Count].Other);
            }
            return seen.Where(piece => piece < regions.List.Count).OrderBy(piece => piece).Select(piece => regions.List[piece]).ToList();
        }
    }
}
