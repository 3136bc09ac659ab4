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

        /// <summary>Of normals of segments, which become the codes of a GPU's vertex.</summary>
        private const double NormalCode = 1.0 / 127;

        private readonly string folder;

        /// <summary>One for all cases: buffers that an earlier payload filled must not show through.</summary>
        private readonly SegmentMesh mesh = new SegmentMesh();

        private readonly SegmentDecoder segments = new SegmentDecoder();
        private readonly GlbDecoder bases = new GlbDecoder();

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
            bool isGood, isSegment = name.EndsWith(".tsg", StringComparison.Ordinal);
            if (!expected["good"].TryFlag(out isGood)) return "its .json does not say whether it is good";
            try
            {
                var bytes = new ArraySegment<byte>(File.ReadAllBytes(path));
                if (isSegment)
                    segments.Decode(bytes, ManifestReader.ReadAttributes(expected["scales"]), mesh);
                else
                    bases.Decode(bytes, mesh);
            }
            // No other exception is caught: one would end the program, and the test sees it.
            catch (PayloadException error)
            {
                return isGood ? "refused: " + error.Message : null;
            }
            if (!isGood) return "was taken; expected: " + expected["error"].Text;
            return Difference(new MeshArrays(mesh), expected, isSegment ? NormalCode : Rounded);
        }

        private static string Difference(MeshArrays decoded, JsonValue expected, double ofNormals)
        {
            // Exact, but for what passes through a root or was rounded when the corpus was written.
            return Apart("positions", decoded.Positions, expected["positions"], 0)
                ?? Apart("faces", Doubles(decoded.Indices), expected["faces"], 0)
                ?? Apart("normals", decoded.Normals, expected["normals"], ofNormals)
                ?? Apart("colours", decoded.Colours == null ? null : Doubles(decoded.Colours), expected["colours"], 0)
                ?? Apart("region_ids", decoded.RegionIds == null ? null : Doubles(decoded.RegionIds), expected["region_ids"], 0)
                ?? Apart("uvs", decoded.Uvs, expected["uvs"], Rounded) ?? Attributes(decoded, expected["attributes"])
                ?? Texture(decoded, expected["texture"]);
        }

        private static string Attributes(MeshArrays decoded, JsonValue expected)
        {
            if (expected.Count != decoded.Attributes.Count) return decoded.Attributes.Count + " attributes, expected " + expected.Count;
            foreach (KeyValuePair<string, float[]> attribute in decoded.Attributes)
            {
                string difference = Apart("attribute " + attribute.Key, attribute.Value, expected[attribute.Key], 0);
                if (difference != null) return difference;
            }
            return null;
        }

        private static string Texture(MeshArrays decoded, JsonValue expected)
        {
            if (expected.IsNull) return decoded.Image == null ? null : "an image, expected none";
            if (decoded.Image == null) return "no image, expected one";
            long width, height;
            expected["width"].TryInteger(out width);
            expected["height"].TryInteger(out height);
            if (decoded.MediaType != expected["media_type"].Text) return "media type " + decoded.MediaType;
            if (decoded.Width != width || decoded.Height != height) return "an image of " + decoded.Width + " x " + decoded.Height;
            using (SHA256 digest = SHA256.Create())
            {
                string hex = BitConverter.ToString(digest.ComputeHash(decoded.Image)).Replace("-", "").ToLowerInvariant();
                return hex == expected["sha256"].Text ? null : "an image with the digest " + hex;
            }
        }

        /// <summary>Compare with nested lists of numbers, null standing for NaN.</summary>
        private static string Apart(string name, float[] decoded, JsonValue expected, double tolerance)
        {
            // An array that a payload has not must be null on both sides.
            if (decoded == null || expected.IsNull) return decoded == null && expected.IsNull ? null : name + " there or not";
            var numbers = new List<double>();
            Flatten(expected, numbers);
            if (numbers.Count != decoded.Length) return name + ": " + decoded.Length + " numbers, expected " + numbers.Count;
            for (int at = 0; at < decoded.Length; at++)
            {
                bool same = double.IsNaN(numbers[at]) ? float.IsNaN(decoded[at]) : Math.Abs(decoded[at] - numbers[at]) <= tolerance;
                if (!same) return name + "[" + at + "] is " + decoded[at].ToString("R") + ", expected " + numbers[at].ToString("R");
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
                // null stands for "no value", which JSON's numbers cannot say.
                into.Add(value.TryNumber(out number) ? number : double.NaN);
            }
        }

        private static float[] Doubles<T>(T[] values)
            where T : IConvertible { return Array.ConvertAll(values, value => value.ToSingle(null)); }
    }
}
