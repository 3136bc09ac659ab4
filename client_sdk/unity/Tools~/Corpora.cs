using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Security.Cryptography;
using System.Text;
using Terraport.Wire;

namespace Terraport.Tools
{
    /// <summary>Runs a corpus of tests/conformance: a line for each case that fails, then "N passed, N failed".</summary>
    internal static class Corpora
    {
        /// <summary>Normals of segments become codes of a GPU's vertex; the corpus rounds texture coordinates to six digits.</summary>
        private const double NormalCode = 1.0 / 127, Rounded = 4e-6;

        /// <summary>Fields that this client does not keep: for logs, or of plans over HTTP alone.</summary>
        private static readonly string[] NotKept = { "server", "pack", "offsets" };

        public static int Run(string kind, string folder)
        {
            int passed = 0, failed = 0;
            foreach (KeyValuePair<string, string> result in Results(kind, folder))
            {
                if (result.Value != null) Console.WriteLine("failed: " + result.Key + ": " + result.Value);
                failed += result.Value == null ? 0 : 1;
                passed += result.Value == null ? 1 : 0;
            }
            Console.WriteLine(passed + " passed, " + failed + " failed");
            return failed == 0 && passed > 0 ? 0 : 1;
        }

        private static IEnumerable<KeyValuePair<string, string>> Results(string kind, string folder)
        {
            if (kind == "payload")
            {
                IEnumerable<string> paths = Directory.GetFiles(folder, "*.tsg").OrderBy(path => path, StringComparer.Ordinal);
                var decoder = new SegmentDecoder();
                // One for all cases: buffers that an earlier payload filled must not show through.
                var mesh = new SegmentMesh();
                return paths.Select(path => new KeyValuePair<string, string>(Path.GetFileName(path), WhyNot(path, decoder, mesh)));
            }
            IEnumerable<Json> cases = Directory.GetFiles(folder, "*.jsonl")
                                          .OrderBy(path => path, StringComparer.Ordinal)
                                          .SelectMany(File.ReadLines)
                                          .Select(line => Json.Read(new ArraySegment<byte>(Encoding.UTF8.GetBytes(line))));
            if (kind == "landings")
                return cases.Select(one => new KeyValuePair<string, string>(one["history"].Text, LandingsCorpus.Difference(one)));
            return cases.Where(one => one["from"].Text == "server")
                .Select(one => new KeyValuePair<string, string>(one["case"].Text, WhyNotMessage(one)));
        }

        private static string WhyNotMessage(Json one)
        {
            byte[] bytes = Convert.FromBase64String(one["bytes"].Text);
            int length = bytes.Length, padded = (int)(one["pad_to"].Integer ?? length);
            Array.Resize(ref bytes, padded);
            for (int at = length; at < padded; at++) bytes[at] = (byte)(one["pad_byte"].Integer ?? 0);
            var message = new ArraySegment<byte>(bytes);
            try
            {
                Frame frame = default;
                bool isFrame = Frame.IsFrame(message);
                ServerMessage read = null;
                bool isTaken = isFrame ? Frame.TryRead(message, out frame) : (read = ServerMessage.Read(message)) != null;
                if (one["refused_by"].Text == "client") return "was taken, expected that it is refused";
                if (one["skip"].Flag == true) return isTaken ? "was taken, expected that it is skipped" : null;
                if (!isTaken) return "was skipped, expected that it is taken";
                return isFrame ? Differs(Shown(frame), one["frame"]) : Differs(ShownMessage.Of(read), one["message"]);
            }
            catch (WireException error)
            {
                return one["refused_by"].Text == "client" ? null : "was refused: " + error.Message;
            }
        }

        private static object Shown(Frame frame)
        {
            return new Dictionary<string, object> {
                { "generation", frame.Generation },
                { "key", frame.Key.ToString("x16") },
                { "offset", frame.Offset },
                { "total", frame.Total },
                { "data", frame.Data },
            };
        }

        /// <summary>Compare what the reader has found with the corpus, as far as the reader keeps it.</summary>
        private static string Differs(object got, Json expected)
        {
            var fields = (Dictionary<string, object>)got;
            foreach (string key in expected.Keys.Except(NotKept))
            {
                if (!fields.ContainsKey(key)) return "has no " + key + ", expected " + Canonical.Text(expected[key].Value);
                string read = Canonical.Text(fields[key]), wanted = Canonical.Text(expected[key].Value);
                if (read != wanted) return key + " is " + read + ", expected " + wanted;
            }
            return null;
        }

        private static string WhyNot(string path, SegmentDecoder decoder, SegmentMesh mesh)
        {
            Json expected = Json.Read(new ArraySegment<byte>(File.ReadAllBytes(path + ".json")));
            bool isGood = expected["good"].Flag.Value;
            IReadOnlyList<AttributeInfo> scales = SceneManifest.ReadAttributes(expected["scales"]);
            try
            {
                decoder.Decode(new ArraySegment<byte>(File.ReadAllBytes(path)), scales.Count, mesh);
            }
            catch (PayloadException error)
            {
                return isGood ? "refused: " + error.Message : null;
            }
            if (!isGood) return "was taken, expected: " + expected["error"].Text;
            Json image = expected["texture"];
            if (mesh.HasImage == image.IsNull) return "has an image or not, expected the opposite";
            if (mesh.HasImage)
            {
                string hash =
                    BitConverter.ToString(SHA256.Create().ComputeHash(mesh.ImageFile.Array, mesh.ImageFile.Offset, mesh.ImageFile.Count));
                string shown = mesh.Image.MediaType + " " + mesh.Image.Width + " " + mesh.Image.Height + " "
                    + hash.Replace("-", "").ToLowerInvariant();
                string wanted =
                    image["media_type"].Text + " " + image["width"].Integer + " " + image["height"].Integer + " " + image["sha256"].Text;
                if (shown != wanted) return "image " + shown + ", expected " + wanted;
            }
            var arrays = new MeshArrays(mesh, scales);
            return Apart("positions", arrays.Positions, expected["positions"], 0) ?? Apart("faces", arrays.Indices, expected["faces"], 0)
                ?? Apart("normals", arrays.Normals, expected["normals"], NormalCode)
                ?? Apart("colours", arrays.Colours, expected["colours"], 0)
                ?? Apart("region_ids", arrays.Regions, expected["region_ids"], 0) ?? Apart("uvs", arrays.Uvs, expected["uvs"], Rounded)
                ?? scales.Select(scale => Apart(scale.Name, arrays.Attributes[scale.Name], expected["attributes"][scale.Name], 0))
                       .FirstOrDefault(text => text != null);
        }

        /// <summary>Compare with nested lists of numbers; null stands for NaN.</summary>
        private static string Apart(string name, Array got, Json expected, double tolerance)
        {
            if (got == null || expected.IsNull)
                return got == null && expected.IsNull ? null : name + " is there or not, expected the opposite";
            List<double> numbers = Flat(expected).ToList();
            if (numbers.Count != got.Length) return name + " has " + got.Length + " numbers, expected " + numbers.Count;
            for (int at = 0; at < numbers.Count; at++)
            {
                double number = Convert.ToDouble(got.GetValue(at));
                bool isSame = double.IsNaN(numbers[at]) ? double.IsNaN(number) : Math.Abs(number - numbers[at]) <= tolerance;
                if (!isSame) return name + "[" + at + "] is " + number + ", expected " + numbers[at];
            }
            return null;
        }

        private static IEnumerable<double> Flat(Json value)
        {
            return value.List == null ? new[] { value.Number ?? double.NaN } : value.List.SelectMany(Flat);
        }
    }
}
