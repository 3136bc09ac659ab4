using System;
using System.Collections.Generic;
using System.Linq;
using System.Reflection;
using System.Text.RegularExpressions;
using Terraport.Wire;

namespace Terraport.Tools
{
    /// <summary>Messages from the service, and parts of them, as the messages corpus writes them: by the names of their fields.</summary>
    internal static class ShownMessage
    {
        private const BindingFlags Members =
            BindingFlags.Instance | BindingFlags.Public | BindingFlags.NonPublic | BindingFlags.DeclaredOnly;

        /// <summary>Fields that have another name, or belong to a part, in the protocol.</summary>
        private static readonly Dictionary<string, string> Names = new Dictionary<string, string> {
            { "is_fatal", "fatal" },
            { "is_present", "present" },
            { "number", "gathering" },
            { "scene_id", "scene.id" },
            { "scene_name", "scene.name" },
            { "version", "scene.version" },
            { "segment_count", "scene.segment_count" },
            { "base_faces", "scene.base_faces" },
            { "levels", "scene.levels" },
        };

        public static Dictionary<string, object> Of(ServerMessage message)
        {
            Dictionary<string, object> fields = FieldsOf(message);
            fields.Add("type", message.GetType().Name.ToLowerInvariant());
            return fields;
        }

        /// <summary>Describe a message or a part; what it lacks is left out.</summary>
        public static Dictionary<string, object> FieldsOf(object part)
        {
            var fields = new Dictionary<string, object>();
            foreach (FieldInfo field in part.GetType().GetFields(Members).Where(field => !field.Name.StartsWith("<")))
                Put(fields, part, field.Name, field.GetValue(part));
            foreach (PropertyInfo property in part.GetType().GetProperties(Members))
                Put(fields, part, property.Name, property.GetValue(part));
            return fields;
        }

        public static object Numbers(Vec3 point) { return new[] { point.X, point.Y, point.Z }; }

        private static void Put(Dictionary<string, object> fields, object part, string name, object value)
        {
            object plain = Plain(value);
            string key = Regex.Replace(name, "(?<=[a-z])[A-Z]", "_$0").ToLowerInvariant();
            if (part is Welcome && (key.StartsWith("max_") || key == "idle_timeout_s" || key == "groups")) key = "limits." + key;
            if (Names.ContainsKey(key) && (part is Welcome || !Names[key].Contains("."))) key = Names[key];
            if (plain == null) return;
            string[] path = key.Split('.');
            if (path.Length == 2 && !fields.ContainsKey(path[0])) fields[path[0]] = new Dictionary<string, object>();
            (path.Length == 2 ? (Dictionary<string, object>)fields[path[0]] : fields)[path.Last()] = plain;
        }

        private static object Plain(object value)
        {
            if (value is Vec3) return Numbers((Vec3)value);
            if (value is GroupRole) return value.ToString().ToLowerInvariant();
            if (value is PickHit) return FieldsOf(value);
            if (value is GroupMember[]) return ((GroupMember[])value).Select(FieldsOf).ToList();
            if (value is PlanRow[]) return Table(((PlanRow[])value).SelectMany(Bytes));
            if (value is ulong[]) return Table(((ulong[])value).SelectMany(BitConverter.GetBytes));
            if (value is uint[]) return Table(((uint[])value).SelectMany(BitConverter.GetBytes));
            return value is ArraySegment<byte> && ((ArraySegment<byte>)value).Array == null ? null : value;
        }

        private static IEnumerable<byte> Bytes(PlanRow row)
        {
            uint flags = (row.IsSent ? 1u : 0) | (row.IsCoarser ? 2u : 0);
            uint[] numbers = { row.Id, row.PayloadBytes, row.Faces, row.Vertices, flags };
            return BitConverter.GetBytes(row.Key).Concat(numbers.SelectMany(BitConverter.GetBytes));
        }

        private static string Table(IEnumerable<byte> bytes) { return Convert.ToBase64String(bytes.ToArray()); }
    }
}
