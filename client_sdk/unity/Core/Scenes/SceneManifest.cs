using System.Collections.Generic;

namespace Terraport
{
    /// <summary>What a client uses of scene.json (scene format, section 4).</summary>
    public sealed class SceneManifest
    {
        internal SceneManifest() {}

        /// <summary>Scene id of the URL.</summary>
        public string Id { get; internal set; }

        /// <summary>Name for people; not unique.</summary>
        public string Name { get; internal set; }

        /// <summary>32 hexadecimal digits: identity of the contents.</summary>
        public string Version { get; internal set; }

        /// <summary>The survey's coordinate reference system; null where it is not known.</summary>
        public string CrsName { get; internal set; }

        /// <summary>Its EPSG code; null without one.</summary>
        public int? CrsEpsg { get; internal set; }

        /// <summary>East of the frame's origin in the survey's CRS, metres.</summary>
        public double OriginEast { get; internal set; }

        /// <summary>North of the frame's origin, metres.</summary>
        public double OriginNorth { get; internal set; }

        /// <summary>Height of the frame's origin, metres.</summary>
        public double OriginHeight { get; internal set; }

        /// <summary>Metres of one step of the scene's grid: a power of two.</summary>
        public double StepM { get; internal set; }

        /// <summary>Lowest corner of all segments and the base, metres, scene frame.</summary>
        public Vec3 BoundsMin { get; internal set; }

        /// <summary>Highest corner of all segments and the base, metres, scene frame.</summary>
        public Vec3 BoundsMax { get; internal set; }

        /// <summary>The survey's attributes, in the order by which segments name theirs.</summary>
        public IReadOnlyList<AttributeInfo> Attributes { get; internal set; }

        /// <summary>Number of segments: the ids of full detail are below it, those of the coarser level from it on.</summary>
        public int SegmentCount { get; internal set; }

        /// <summary>Levels of every segment: 1, or 2 with a coarser one.</summary>
        public int Levels { get; internal set; }

        /// <summary>Triangles of the base.</summary>
        public int BaseFaces { get; internal set; }

        /// <summary>Triangles of all segments.</summary>
        public long DetailFaces { get; internal set; }

        /// <summary>Whether every segment has vertex colours, and the base those or a texture.</summary>
        public bool HasColour { get; internal set; }

        /// <summary>Media types of the payloads' images; empty without textures.</summary>
        public IReadOnlyList<string> TextureTypes { get; internal set; }

        /// <summary>Whether textures, be it the base's alone, show the points' colours and no photographs.</summary>
        public bool TexturesOfPoints { get; internal set; }

        /// <summary>How far the base is drawn pushed back along the line of sight, metres.</summary>
        public double DeviationM { get; internal set; }

        /// <summary>Names of the encodings that payloads come in; "segment-2" is among them.</summary>
        public IReadOnlyList<string> Encodings { get; internal set; }

        /// <summary>Length and hash of base.glb.</summary>
        internal FileFacts BaseFile { get; set; }

        /// <summary>Length and hash of base.cover.</summary>
        internal FileFacts CoverFile { get; set; }

        /// <summary>Length and hash of regions.json.</summary>
        internal FileFacts RegionsFile { get; set; }

        /// <summary>East, north and height, metres in the survey's CRS, of a position in the scene frame.</summary>
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
            // Not -(north - OriginNorth): that would make a minus zero of the origin itself.
            return new Vec3(east - OriginEast, height - OriginHeight, OriginNorth - north);
        }
    }
}
