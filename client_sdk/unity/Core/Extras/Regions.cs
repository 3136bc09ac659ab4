using System;
using System.Collections.Generic;
using System.Linq;

namespace Terraport
{
    /// <summary>One region of the ground. What the scene does not say is null.</summary>
    internal sealed class Region
    {
        internal int Id;
        internal long? StableId;
        internal string Label;
        internal double? AreaM2;
        internal Vec3? Centroid;

        /// <summary>Where it is seen best, and by which radius and heading.</summary>
        internal Vec3? ViewPosition;
        internal double? ViewHeadingDeg, ViewRadiusM;
    }

    /// <summary>Two pieces that are united at a cost: regions by their id, or R + m for the union m, with R regions.</summary>
    internal struct RegionUnion
    {
        internal int One, Other;
        internal double Cost;
    }

    /// <summary>regions.json and labels.json (scene format, section 11).</summary>
    internal sealed class Regions
    {
        internal IReadOnlyList<Region> List = Array.Empty<Region>();
        internal IReadOnlyList<RegionUnion> Unions = Array.Empty<RegionUnion>();

        /// <summary>
        /// Read the regions. Everything but their order is informative. Damaged labels give no label: a name must never take the ground away.
        /// </summary>
        /// <exception cref="PayloadException">There is no list of regions, or an id is not the position in it.</exception>
        internal static Regions Read(ArraySegment<byte> regions, ArraySegment<byte> labels)
        {
            Json json = Json.Read(regions);
            IReadOnlyList<Json> rows = Json.Expect(json["regions"].List, "list of regions");
            Dictionary<long, string> names = ReadLabels(labels);
            var list = new Region[rows.Count];
            for (int at = 0; at < list.Length; at++)
            {
                if (rows[at]["id"].Integer != at) throw new PayloadException("got another id of region " + at + ", expected its position");
                list[at] = ReadRegion(rows[at], at, names);
            }
            return new Regions { List = list, Unions = ReadUnions(json["unions"].List, list.Length) };
        }

        private static Region ReadRegion(Json row, int id, Dictionary<long, string> names)
        {
            long? stableId = row["stable_id"].Integer;
            string label = null;
            // labels.json is written after publishing: it wins over the label of the build.
            if (stableId == null || !names.TryGetValue(stableId.Value, out label)) label = row["label"].Text;
            Json place = row["place"];
            bool hasView = place["position"].Point != null && place["radius_m"].Number > 0;
            return new Region {
                Id = id,
                StableId = stableId,
                Label = string.IsNullOrEmpty(label) ? null : label,
                AreaM2 = row["area_m2"].Number,
                Centroid = row["centroid"].Point,
                ViewPosition = hasView ? place["position"].Point : null,
                ViewHeadingDeg = hasView ? place["heading_deg"].Number : null,
                ViewRadiusM = hasView ? place["radius_m"].Number : null,
            };
        }

        private static Dictionary<long, string> ReadLabels(ArraySegment<byte> text)
        {
            var names = new Dictionary<long, string>();
            try
            {
                IReadOnlyList<Json> rows = text.Count == 0 ? null : Json.Read(text)["labels"].List;
                foreach (Json row in rows ?? Array.Empty<Json>())
                {
                    if (row["stable_id"].Integer.HasValue && row["label"].Text != null)
                        names[row["stable_id"].Integer.Value] = row["label"].Text;
                }
            }
            catch (PayloadException)
            {
            }
            return names;
        }

        private static List<RegionUnion> ReadUnions(IReadOnlyList<Json> rows, int regionCount)
        {
            var unions = new List<RegionUnion>();
            foreach (IReadOnlyList<Json> row in (rows ?? Array.Empty<Json>()).Select(row => row.List))
            {
                long? one = row?.Count == 3 ? row[0].Integer : null, other = row?.Count == 3 ? row[1].Integer : null;
                double? cost = row?.Count == 3 ? row[2].Number : null;
                // What follows a union that is not as it should be would name pieces that are not there.
                if (cost == null || !(one >= 0 && one < other && other < regionCount + unions.Count)) break;
                unions.Add(new RegionUnion { One = (int)one, Other = (int)other, Cost = cost.Value });
            }
            return unions;
        }
    }
}
