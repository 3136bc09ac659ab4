using System;
using System.Collections.Generic;
using Terraport.Json;

namespace Terraport
{
    /// <summary>
    /// regions.json and labels.json: what is known of the regions, and what people call them (scene format, section 11).
    /// </summary>
    public static class RegionsReader
    {
        private const int MaxLabelLength = 256;
        /// <summary>A whole file of 256 MiB has fewer values that mean anything.</summary>
        private const int MaxValues = 1 << 24;

        /// <summary>
        /// Read the regions. Everything but their order is informative: a fact that is missing, or not what it should be, is null.
        /// </summary>
        /// <param name="regions">regions.json.</param>
        /// <param name="labels">labels.json; empty without one. Damaged, it gives no label: a name must never take the ground away.</param>
        /// <param name="unions">How they unite to coarser pieces, up to the first union that is not as it should be; empty without any.</param>
        /// <exception cref="PayloadException">There is no list of regions, or an id is not the position in it.</exception>
        public static IReadOnlyList<RegionFacts> Read(
            ArraySegment<byte> regions, ArraySegment<byte> labels, out IReadOnlyList<RegionUnion> unions)
        {
            JsonValue json;
            try
            {
                json = JsonReader.Read(regions, MaxValues);
            }
            catch (JsonException error)
            {
                throw new PayloadException("regions.json does not parse: " + error.Message);
            }
            JsonValue list = SceneJson.ExpectList(SceneJson.ExpectObject(json, "regions.json")["regions"], "regions");
            Dictionary<long, string> names = ReadLabels(labels);
            var facts = new RegionFacts[list.Count];
            for (int at = 0; at < facts.Length; at++)
            {
                JsonValue region = SceneJson.ExpectObject(list[at], "region");
                // The one thing that is not informative: payloads name regions by this position.
                if (SceneJson.ExpectWhole(region["id"], "id of a region", 0, int.MaxValue) != at)
                {
                    throw new PayloadException("region " + at + " has another id, expected its position");
                }
                facts[at] = ReadRegion(region, at, names);
            }
            unions = ReadUnions(json["unions"], facts.Length);
            return facts;
        }

        private static IReadOnlyList<RegionUnion> ReadUnions(JsonValue rows, int regionCount)
        {
            List<RegionUnion> unions = new List<RegionUnion>();
            for (int at = 0; rows.Kind == JsonKind.List && at < rows.Count; at++)
            {
                JsonValue row = rows[at];
                long one, other;
                double? cost = row.Kind == JsonKind.List && row.Count == 3 ? SceneJson.NumberOrNull(row[2]) : null;
                if (cost == null || !row[0].TryInteger(out one) || !row[1].TryInteger(out other) || one < 0 || one >= other
                    || other >= regionCount + unions.Count)
                {
                    break; // What follows would name pieces that are not there.
                }
                unions.Add(new RegionUnion { One = (int)one, Other = (int)other, Cost = cost.Value });
            }
            return unions;
        }

        private static RegionPlace PlaceOrNull(JsonValue place)
        {
            Vec3? position = SceneJson.TripleOrNull(place["position"]);
            double? heading = SceneJson.NumberOrNull(place["heading_deg"]), radius = SceneJson.NumberOrNull(place["radius_m"]);
            return position == null || heading == null || radius == null || radius <= 0
                ? null
                : new RegionPlace { Position = position.Value, HeadingDeg = heading.Value, RadiusM = radius.Value };
        }

        private static RegionFacts ReadRegion(JsonValue region, int id, Dictionary<long, string> names)
        {
            long stableId;
            // labels.json is written after publishing and may rename: it wins over the label of the build.
            bool hasStable = region["stable_id"].TryInteger(out stableId) && stableId >= 0 && stableId <= uint.MaxValue;
            string label = null;
            if (!hasStable || !names.TryGetValue(stableId, out label))
            {
                // No word of people's: the build's own, if it has one.
                label = string.IsNullOrEmpty(region["label"].Text) ? null : region["label"].Text;
            }
            return new RegionFacts {
                Id = id,
                StableId = hasStable ? stableId : (long?)null,
                Label = label,
                AreaM2 = SceneJson.NumberOrNull(region["area_m2"]),
                MeanColour = SceneJson.TripleOrNull(region["mean_colour"]),
                SlopeDeg = SceneJson.NumberOrNull(region["slope_deg"]["mean"]),
                Centroid = SceneJson.TripleOrNull(region["centroid"]),
                Place = PlaceOrNull(region["place"]),
            };
        }

        private static Dictionary<long, string> ReadLabels(ArraySegment<byte> text)
        {
            var noLabels = new Dictionary<long, string>();
            JsonValue json;
            try
            {
                json = text.Count == 0 ? default(JsonValue) : JsonReader.Read(text);
            }
            catch (JsonException)
            {
                return noLabels;
            }
            string version = json["format_version"].Text;
            JsonValue rows = json["labels"];
            if (json["format"].Text != "terraport-labels" || version == null || version.Split('.')[0] != "1" || rows.Kind != JsonKind.List)
            {
                return noLabels;
            }
            var labels = new Dictionary<long, string>();
            long previousId = -1;
            for (int at = 0; at < rows.Count; at++)
            {
                long stableId;
                // Ascending, each once. One wrong row makes the whole file doubtful: none of its labels counts.
                bool isValid = rows[at]["stable_id"].TryInteger(out stableId) && stableId > previousId && stableId <= uint.MaxValue;
                string label = rows[at]["label"].Text;
                if (!isValid || !IsLabel(label))
                {
                    return noLabels;
                }
                labels.Add(stableId, label);
                previousId = stableId;
            }
            return labels;
        }

        /// <summary>1 to 256 code points, no control character, no blank at either end.</summary>
        private static bool IsLabel(string label)
        {
            if (string.IsNullOrEmpty(label) || label != label.Trim())
            {
                return false;
            }
            int points = 0;
            foreach (char character in label)
            {
                if (char.IsControl(character))
                {
                    return false;
                }
                // Code points: the halves of a surrogate pair count once.
                points += char.IsLowSurrogate(character) ? 0 : 1;
            }
            return points <= MaxLabelLength;
        }
    }
}
