using System;
using System.Collections.Generic;
using System.Linq;

namespace Terraport
{
    /// <summary>One attribute of the survey: a value is Offset + Step x code.</summary>
    public sealed class AttributeInfo
    {
        /// <summary>Name in the survey.</summary>
        public string Name { get; internal set; }

        internal double Offset, Step;
    }

    /// <summary>What a client uses of scene.json (scene format, section 4).</summary>
    public sealed class SceneManifest
    {
        private const string Encoding = "segment-2";

        private SceneManifest() {}

        /// <summary>Scene id of the URL.</summary>
        public string Id { get; private set; }

        /// <summary>Name for people; not unique.</summary>
        public string Name { get; private set; }

        /// <summary>32 hexadecimal digits: identity of the contents.</summary>
        public string Version { get; private set; }

        /// <summary>Name of the survey's coordinate reference system; null where it is not known.</summary>
        public string CrsName { get; private set; }

        /// <summary>Easting, northing and height of the frame's origin in the survey's CRS, metres.</summary>
        public double OriginEast { get; private set; }

        /// <summary>Northing of the frame's origin, metres.</summary>
        public double OriginNorth { get; private set; }

        /// <summary>Height of the frame's origin, metres.</summary>
        public double OriginHeight { get; private set; }

        /// <summary>Lowest corner of all segments and the base, metres, scene frame.</summary>
        public Vec3 BoundsMin { get; private set; }

        /// <summary>Highest corner of all segments and the base, metres, scene frame.</summary>
        public Vec3 BoundsMax { get; private set; }

        /// <summary>The survey's attributes.</summary>
        public IReadOnlyList<AttributeInfo> Attributes { get; private set; }

        /// <summary>Number of segments: ids of full detail are below it, those of the coarser level from it on.</summary>
        public int SegmentCount { get; private set; }

        /// <summary>Levels of every segment: 1, or 2 with a coarser one.</summary>
        public int Levels { get; private set; }

        /// <summary>Triangles of the base.</summary>
        public int BaseFaces { get; private set; }

        /// <summary>Whether images, be it the base's alone, show the points' colours and no photographs.</summary>
        public bool HasImagesOfPoints { get; private set; }

        /// <summary>How far the base is drawn pushed back along the line of sight, metres.</summary>
        public double DeviationM { get; private set; }

        /// <summary>Easting, northing and height, metres in the survey's CRS, of a position in the scene frame.</summary>
        public void ToSurvey(Vec3 position, out double east, out double north, out double height)
        {
            // The scene's z points south, the survey's northing north.
            east = OriginEast + position.X;
            north = OriginNorth - position.Z;
            height = OriginHeight + position.Y;
        }

        /// <summary>Position in the scene frame, metres, of a point in the survey's CRS.</summary>
        public Vec3 FromSurvey(double east, double north, double height)
        {
            return new Vec3(east - OriginEast, height - OriginHeight, OriginNorth - north);
        }

        /// <summary>Read a manifest; keys that are not known are skipped.</summary>
        /// <exception cref="TerraportException">"damaged" or "unsupported_version".</exception>
        internal static SceneManifest Read(ArraySegment<byte> text, string id)
        {
            Json json = Json.Read(text);
            if (json["format"].Text != "terraport-scene")
                throw new TerraportException(
                    "damaged", "got format " + json["format"].Text + ", expected terraport-scene; is this a terraport server?");
            string version = json["format_version"].Text;
            // A newer minor version only adds keys.
            if (version == null || version.Split('.')[0] != "1" || json["encodings"][Encoding].IsNull)
                throw new TerraportException("unsupported_version",
                    "got scene format " + version + ", expected 1.x with " + Encoding + "; a newer client is needed");
            Vec3 origin = Json.Expect(json["origin"].Point, "origin");
            return new SceneManifest {
                Id = id,
                Name = Json.Expect(json["name"].Text, "name"),
                Version = Json.Expect(json["version"].Text, "version"),
                CrsName = json["crs"]["name"].Text,
                OriginEast = origin.X,
                OriginNorth = origin.Y,
                OriginHeight = origin.Z,
                BoundsMin = Json.Expect(json["bounds"]["min"].Point, "bounds.min"),
                BoundsMax = Json.Expect(json["bounds"]["max"].Point, "bounds.max"),
                Attributes = ReadAttributes(json["attributes"]),
                SegmentCount = (int)Json.Expect(json["counts"]["segments"].Integer, "counts.segments"),
                Levels = (int)(json["levels"].Integer ?? 1),
                BaseFaces = (int)Json.Expect(json["counts"]["base_faces"].Integer, "counts.base_faces"),
                HasImagesOfPoints = json["textures"]["source"].Text == "vertex",
                DeviationM = Json.Expect(json["hand_off"]["deviation_m"].Number, "hand_off.deviation_m"),
            };
        }

        /// <summary>Read the list of attributes; also that of the payload corpus.</summary>
        internal static IReadOnlyList<AttributeInfo> ReadAttributes(Json list)
        {
            return Json.Expect(list.List, "attributes")
                .Select(row => new AttributeInfo {
                    Name = Json.Expect(row["name"].Text, "name of an attribute"),
                    Offset = Json.Expect(row["offset"].Number, "offset of an attribute"),
                    Step = Json.Expect(row["step"].Number, "step of an attribute"),
                })
                .ToArray();
        }
    }
}
