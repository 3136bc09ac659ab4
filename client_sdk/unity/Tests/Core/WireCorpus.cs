using System;
using System.Collections.Generic;
using System.IO;
using Terraport.Json;

namespace Terraport.Tests
{
    /// <summary>The files of tests/conformance/wire, as <see cref="Repository"/> finds them.</summary>
    internal static class WireCorpus
    {
        /// <summary>Names of the cases in one of the folders "good" and "bad".</summary>
        internal static List<string> Names(string kind)
        {
            var names = new List<string>();
            foreach (string path in Directory.GetFiles(FolderOf(kind), "*.json"))
            {
                names.Add(Path.GetFileNameWithoutExtension(path));
            }
            names.Sort(StringComparer.Ordinal);
            return names;
        }

        /// <summary>What a case is, and its bytes, padded as it asks.</summary>
        internal static JsonValue Read(string kind, string name, out byte[] data)
        {
            string path = Path.Combine(FolderOf(kind), name);
            JsonValue facts = JsonReader.Read(new ArraySegment<byte>(File.ReadAllBytes(path + ".json")));
            data = File.ReadAllBytes(path + ".bin");
            long size;
            if (!facts["pad_to"].TryInteger(out size) || size <= data.Length) return facts;
            long with;
            facts["pad_byte"].TryInteger(out with);
            int stored = data.Length;
            Array.Resize(ref data, (int)size);
            for (int index = stored; index < data.Length; index++) data[index] = (byte)with;
            return facts;
        }

        private static string FolderOf(string kind) { return Repository.PathTo("tests/conformance/wire/" + kind); }
    }
}
