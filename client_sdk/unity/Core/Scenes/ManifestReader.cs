using System;
using System.Collections.Generic;
using System.Globalization;
using Terraport.Json;

namespace Terraport
{
    /// <summary>scene.json as a server gives it, checked for what a client uses (scene format, section 4).</summary>
    public static class ManifestReader
    {
        private const string Major = "1";
        /// <summary>Highest code of an attribute that is a value.</summary>
        private const int MaxCode = 65534;

        /// <summary>Read a manifest; keys that are not known are skipped.</summary>
        /// <param name="text">UTF-8 JSON.</param>
        /// <param name="id">Scene id of the URL.</param>
        /// <exception cref="TerraportException">
        /// "unsupported_version" for another major version; "damaged" for another format, and where a needed key is missing or not
        /// what it should be.
        /// </exception>
        public static SceneManifest Read(ArraySegment<byte> text, string id)
        {
            JsonValue json;
            try
            {
                json = JsonReader.Read(text);
            }
            catch (JsonException error)
            {
                string message = "manifest of scene " + id + " is no JSON; is this a terraport server?";
                throw new TerraportException("damaged", message, null, error);
            }
            CheckFormat(json);
            try
            {
                return ReadChecked(json, id);
            }
            catch (PayloadException error)
            {
                string message = "manifest of scene " + id + ": " + error.Message + "; the scene must be published anew";
                throw new TerraportException("damaged", message, null, error);
            }
        }

        private static void CheckFormat(JsonValue json)
        {
            if (json["format"].Text != "terraport-scene")
            {
                string message = "got format " + json["format"].Show() + ", expected \"terraport-scene\"; is this a terraport server?";
                throw new TerraportException("damaged", message);
            }
            string version = json["format_version"].Text;
            // A newer minor version only adds: keys that are not known here are skipped.
            if (version == null || version.Split('.')[0] != Major)
            {
                string message = "got scene format " + json["format_version"].Show() + ", expected 1.x; a newer client is needed";
                throw new TerraportException("unsupported_version", message);
            }
        }

        private static SceneManifest ReadChecked(JsonValue json, string id)
        {
            JsonValue counts = SceneJson.ExpectObject(json["counts"], "counts");
            JsonValue files = SceneJson.ExpectObject(json["files"], "files");
            JsonValue encodings = SceneJson.ExpectObject(json["encodings"], "encodings");
            // The one encoding that this client decodes must be among them.
            SceneJson.ExpectObject(encodings[SegmentDecoder.Encoding], "encodings." + SegmentDecoder.Encoding);
            Vec3 origin = SceneJson.ExpectTriple(json["origin"], "origin");
            JsonValue bounds = SceneJson.ExpectObject(json["bounds"], "bounds");
            var manifest = new SceneManifest {
                Id = id,
                Name = SceneJson.ExpectText(json["name"], "name"),
                Version = SceneJson.ExpectDigits(json["version"], "version", 32),
                OriginEast = origin.X,
                OriginNorth = origin.Y,
                OriginHeight = origin.Z,
                StepM = ReadStep(json["step_m"]),
                BoundsMin = SceneJson.ExpectTriple(bounds["min"], "bounds.min"),
                BoundsMax = SceneJson.ExpectTriple(bounds["max"], "bounds.max"),
                Attributes = ReadAttributes(json["attributes"]),
                SegmentCount = (int)SceneJson.ExpectWhole(counts["segments"], "counts.segments", 1, 1 << 25),
                Levels = json["levels"].IsNull ? 1 : (int)SceneJson.ExpectWhole(json["levels"], "levels", 1, 2),
                BaseFaces = (int)SceneJson.ExpectWhole(counts["base_faces"], "counts.base_faces", 1, 1 << 27),
                DetailFaces = SceneJson.ExpectWhole(counts["detail_faces"], "counts.detail_faces", 1, long.MaxValue),
                HasColour = SceneJson.ExpectFlag(json["has_colour"], "has_colour"),
                TextureTypes = ReadTextureTypes(json["textures"]),
                TexturesOfPoints = AreOfPoints(json["textures"]),
                DeviationM = ReadDeviation(json["hand_off"]),
                Encodings = NamesOf(encodings),
                BaseFile = ReadFile(files, "base.glb", 1 << 30),
                CoverFile = ReadFile(files, "base.cover", 1 << 26),
                RegionsFile = ReadFile(files, "regions.json", 1 << 28),
            };
            // Each corner was checked by itself; together they must be a box.
            Vec3 low = manifest.BoundsMin;
            Vec3 high = manifest.BoundsMax;
            if (low.X > high.X || low.Y > high.Y || low.Z > high.Z)
            {
                throw new PayloadException("bounds.min is above bounds.max");
            }
            ReadCrs(json["crs"], manifest);
            return manifest;
        }

        private static void ReadCrs(JsonValue crs, SceneManifest manifest)
        {
            if (crs.IsNull)
            {
                return;
            }
            manifest.CrsName = SceneJson.ExpectText(SceneJson.ExpectObject(crs, "crs")["name"], "crs.name");
            if (!crs["epsg"].IsNull)
            {
                manifest.CrsEpsg = (int)SceneJson.ExpectWhole(crs["epsg"], "crs.epsg", 0, int.MaxValue);
            }
        }

        private static double ReadStep(JsonValue value)
        {
            double step = SceneJson.ExpectNumber(value, "step_m");
            // A power of two has no bits of mantissa.
            // By bits: logarithms round.
            bool isPower = step > 0 && (BitConverter.DoubleToInt64Bits(step) & 0xFFFFFFFFFFFFF) == 0;
            return isPower ? step : throw SceneJson.Wrong(value, "step_m", "a power of two");
        }

        private static double ReadDeviation(JsonValue handOff)
        {
            JsonValue value = SceneJson.ExpectObject(handOff, "hand_off")["deviation_m"];
            double length = SceneJson.ExpectNumber(value, "hand_off.deviation_m");
            return length >= 0 ? length : throw SceneJson.Wrong(value, "hand_off.deviation_m", "a length");
        }

        /// <summary>The survey's attributes: the list that a manifest has of them.</summary>
        /// <exception cref="PayloadException">A row is not what it should be.</exception>
        public static IReadOnlyList<AttributeInfo> ReadAttributes(JsonValue list)
        {
            var attributes = new AttributeInfo[SceneJson.ExpectList(list, "attributes").Count];
            for (int at = 0; at < attributes.Length; at++)
            {
                JsonValue row = SceneJson.ExpectObject(list[at], "attribute");
                string name = SceneJson.ExpectText(row["name"], "name of an attribute");
                double offset = SceneJson.ExpectNumber(row["offset"], "offset of " + name);
                double step = SceneJson.ExpectNumber(row["step"], "step of " + name);
                // Both ends of the range are checked once, so that no value needs a check.
                if (!(step > 0 && Math.Abs(offset) <= float.MaxValue && Math.Abs(offset + step * MaxCode) <= float.MaxValue))
                {
                    throw SceneJson.Wrong(row["step"], "step of " + name, "a number above 0 and all values within float32");
                }
                // An attribute that has no value anywhere has no extremes.
                attributes[at] = new AttributeInfo(name, offset, step, Extreme(row["min"], name), Extreme(row["max"], name));
            }
            return attributes;
        }

        private static double? Extreme(JsonValue value, string name)
        {
            return value.IsNull ? (double?)null : SceneJson.ExpectNumber(value, "min or max of " + name);
        }

        private static IReadOnlyList<string> ReadTextureTypes(JsonValue textures)
        {
            if (textures.IsNull)
            {
                return Array.Empty<string>();
            }
            JsonValue list = SceneJson.ExpectList(SceneJson.ExpectObject(textures, "textures")["media_types"], "textures.media_types");
            var types = new string[list.Count];
            for (int at = 0; at < types.Length; at++)
            {
                types[at] = SceneJson.ExpectText(list[at], "textures.media_types");
            }
            return types;
        }

        private static bool AreOfPoints(JsonValue textures)
        {
            return !textures.IsNull && SceneJson.ExpectText(textures["source"], "textures.source") == "vertex";
        }

        private static IReadOnlyList<string> NamesOf(JsonValue encodings)
        {
            var names = new string[encodings.Count];
            for (int at = 0; at < names.Length; at++)
            {
                names[at] = encodings.Members.NameAt(at);
            }
            return names;
        }

        private static FileFacts ReadFile(JsonValue files, string key, int maxBytes)
        {
            JsonValue file = SceneJson.ExpectObject(files[key], key);
            string digits = SceneJson.ExpectDigits(file["xxh3"], "xxh3 of " + key, 16);
            return new FileFacts {
                Length = (int)SceneJson.ExpectWhole(file["bytes"], "bytes of " + key, 1, maxBytes),
                Xxh3 = ulong.Parse(digits, NumberStyles.HexNumber, CultureInfo.InvariantCulture),
            };
        }
    }
}
