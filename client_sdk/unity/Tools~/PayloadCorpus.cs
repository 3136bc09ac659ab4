using System;
using System.Collections.Generic;
using System.IO;
using System.Security.Cryptography;
using Terraport.Json;

namespace Terraport.Tools
{
    /// <summary>
    /// Runs tests/conformance/scene/payload: good payloads value for value against what the Python decoder found, bad ones
    /// must be refused with a <see cref="PayloadException"/>.
    /// </summary>
    internal sealed class PayloadCorpus
    {
        /// <summary>Of what the corpus rounds to six digits.</summary>
        private const double Rounded = 4e-6;

        private readonly string folder;

        /// <summary>One for all cases: buffers that an earlier payload filled must not show through.</summary>
        private readonly SegmentMesh mesh = new SegmentMesh();

        private readonly SegmentDecoder decoder = new SegmentDecoder();

        public PayloadCorpus(string folder) { this.folder = folder; }

        public int Run()
        {
            var tally = new Tally();
            var names = new List<string>();
            foreach (string path in Directory.GetFiles(folder))
            {
                if (!path.EndsWith(".json", StringComparison.Ordinal)) names.Add(Path.GetFileName(path));
            }
            names.Sort(StringComparer.Ordinal);
            foreach (string name in names) tally.Add(name, WhyNot(name));
            return tally.Finish();
        }

        /// <summary>What is wrong with a case; null where it is as it should be.</summary>
        private string WhyNot(string name)
        {
            string path = Path.Combine(folder, name);
            JsonValue expected = JsonReader.Read(new ArraySegment<byte>(File.ReadAllBytes(path + ".json")));
            bool isGood;
            if (!expected["good"].TryFlag(out isGood)) return "its .json does not say whether it is good";
            try
            {
                decoder.Decode(new ArraySegment<byte>(File.ReadAllBytes(path)), mesh);
            }
            catch (PayloadException error)
            {
                return isGood ? "refused: " + error.Message : null;
            }
            if (!isGood) return "was taken; expected: " + expected["error"].Text;
            return Difference(new MeshArrays(mesh), expected);
        }

        private static string Difference(MeshArrays found, JsonValue expected)
        {
            return Apart("positions", found.Positions, expected["positions"], 0)
                ?? Apart("faces", Doubles(found.Indices), expected["faces"], 0)
                ?? Apart("normals", found.Normals, expected["normals"], Rounded)
                ?? Apart("colours", found.Colours == null ? null : Doubles(found.Colours), expected["colours"], 0)
                ?? Apart("region_ids", found.RegionIds == null ? null : Doubles(found.RegionIds), expected["region_ids"], 0)
                ?? Apart("uvs", found.Uvs, expected["uvs"], Rounded) ?? Attributes(found, expected["attributes"])
                ?? Texture(found, expected["texture"]);
        }

        private static string Attributes(MeshArrays found, JsonValue expected)
        {
            if (expected.Count != found.Attributes.Count) return found.Attributes.Count + " attributes, expected " + expected.Count;
            foreach (KeyValuePair<string, float[]> attribute in found.Attributes)
            {
                string difference = Apart("attribute " + attribute.Key, attribute.Value, expected[attribute.Key], 0);
                if (difference != null) return difference;
            }
            return null;
        }

        private static string Texture(MeshArrays found, JsonValue expected)
        {
            if (expected.IsNull) return found.Image == null ? null : "an image, expected none";
            if (found.Image == null) return "no image, expected one";
            long width, height;
            expected["width"].TryInteger(out width);
            expected["height"].TryInteger(out height);
            if (found.MediaType != expected["media_type"].Text) return "media type " + found.MediaType;
            if (found.Width != width || found.Height != height) return "an image of " + found.Width + " x " + found.Height;
            using (SHA256 digest = SHA256.Create())
            {
                string hex = BitConverter.ToString(digest.ComputeHash(found.Image)).Replace("-", "").ToLowerInvariant();
                return hex == expected["sha256"].Text ? null : "an image with the digest " + hex;
            }
        }

        /// <summary>Compare with nested lists of numbers, null standing for NaN.</summary>
        private static string Apart(string name, float[] found, JsonValue expected, double tolerance)
        {
            if (found == null || expected.IsNull) return found == null && expected.IsNull ? null : name + " there or not";
            var wanted = new List<double>();
            Flatten(expected, wanted);
            if (wanted.Count != found.Length) return name + ": " + found.Length + " numbers, expected " + wanted.Count;
            for (int at = 0; at < found.Length; at++)
            {
                bool same = double.IsNaN(wanted[at]) ? float.IsNaN(found[at]) : Math.Abs(found[at] - wanted[at]) <= tolerance;
                if (!same) return name + "[" + at + "] is " + found[at].ToString("R") + ", expected " + wanted[at].ToString("R");
            }
            return null;
        }

        private static void Flatten(JsonValue value, List<double> into)
        {
            double number;
            if (value.Kind == JsonKind.List)
            {
                for (int at = 0; at < value.Count; at++) Flatten(value[at], into);
            }
            else
            {
                into.Add(value.TryNumber(out number) ? number : double.NaN);
            }
        }

        private static float[] Doubles<T>(T[] values)
            where T : IConvertible { return Array.ConvertAll(values, value => value.ToSingle(null)); }
    }
}
