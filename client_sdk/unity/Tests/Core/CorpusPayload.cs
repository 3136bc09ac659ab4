using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using Terraport.Json;

namespace Terraport.Tests
{
    /// <summary>A payload of the scene corpus: a segment, or a base as GLB; and the JSON beside it.</summary>
    internal sealed class CorpusPayload
    {
        private const string Folder = "tests/conformance/scene/payload/";
        private readonly SegmentDecoder segments = new SegmentDecoder();
        private readonly GlbDecoder bases = new GlbDecoder();

        internal CorpusPayload(string name)
        {
            string path = Repository.PathTo(Folder + name);
            Name = name;
            Bytes = File.ReadAllBytes(path);
            Expected = JsonReader.Read(new ArraySegment<byte>(File.ReadAllBytes(path + ".json")));
        }

        /// <summary>Every payload whose name starts so.</summary>
        internal static IEnumerable<CorpusPayload> All(string start)
        {
            IEnumerable<string> names = Directory.GetFiles(Repository.PathTo(Folder), start + "*").Select(Path.GetFileName);
            return names.Where(name => !name.EndsWith(".json", StringComparison.Ordinal)).Select(name => new CorpusPayload(name));
        }

        internal string Name { get; private set; }

        internal byte[] Bytes { get; private set; }

        internal JsonValue Expected { get; private set; }

        internal bool IsSegment => Name.EndsWith(".tsg", StringComparison.Ordinal);

        /// <summary>Of the scene that a segment belongs to.</summary>
        internal IReadOnlyList<AttributeInfo> Attributes => ManifestReader.ReadAttributes(Expected["scales"]);

        /// <summary>Decode bytes as this payload is decoded: its own, or damaged ones.</summary>
        internal void Decode(ArraySegment<byte> bytes, SegmentMesh into)
        {
            if (IsSegment)
                segments.Decode(bytes, Attributes, into);
            else
                bases.Decode(bytes, into);
        }
    }
}
