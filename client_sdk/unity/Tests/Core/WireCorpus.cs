using System;
using System.Collections.Generic;
using System.IO;
using Terraport.Json;

namespace Terraport.Tests
{
    /// <summary>The files of tests/conformance/wire; none where the tests run outside the repository.</summary>
    internal static class WireCorpus
    {
        /// <summary>Names the folder where it cannot be found from the place of the tests.</summary>
        private const string Variable = "TERRAPORT_WIRE_CORPUS";

        internal static readonly string Folder = Find();

        /// <summary>Names of the cases in one of the folders "good" and "bad".</summary>
        internal static List<string> Names(string kind)
        {
            var names = new List<string>();
            if (Folder == null) return names;
            foreach (string path in Directory.GetFiles(Path.Combine(Folder, kind), "*.json"))
            {
                names.Add(Path.GetFileNameWithoutExtension(path));
            }
            names.Sort(StringComparer.Ordinal);
            return names;
        }

        /// <summary>What a case is, and its bytes, padded as it asks.</summary>
        internal static JsonValue Read(string kind, string name, out byte[] data)
        {
            string path = Path.Combine(Path.Combine(Folder, kind), name);
            JsonValue facts = JsonReader.Read(new ArraySegment<byte>(File.ReadAllBytes(path + ".json")));
            data = File.ReadAllBytes(path + ".bin");
            long size;
            if (!facts["pad_to"].TryInteger(out size) || size <= data.Length) return facts;
            long with;
            facts["pad_byte"].TryInteger(out with);
            int stored = data.Length;
            Array.Resize(ref data, (int)size);
            for (int place = stored; place < data.Length; place++) data[place] = (byte)with;
            return facts;
        }

        private static string Find()
        {
            string given = Environment.GetEnvironmentVariable(Variable);
            if (!string.IsNullOrEmpty(given)) return given;
            foreach (string start in new[] { AppDomain.CurrentDomain.BaseDirectory, Directory.GetCurrentDirectory() })
            {
                for (DirectoryInfo at = new DirectoryInfo(start); at != null; at = at.Parent)
                {
                    string folder = Path.Combine(Path.Combine(Path.Combine(at.FullName, "tests"), "conformance"), "wire");
                    if (Directory.Exists(Path.Combine(folder, "good"))) return folder;
                }
            }
            return null;
        }
    }
}
