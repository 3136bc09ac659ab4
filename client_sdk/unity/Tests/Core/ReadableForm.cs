using System;
using System.Collections.Generic;
using System.Linq;
using System.Reflection;
using System.Text;
using Terraport.Json;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>
    /// A message as the corpus states it (wire protocol, section 15): tables as lists of rows, hashes as text. The tool that runs
    /// the corpus compiles this file too.
    /// </summary>
    internal static class ReadableForm
    {
        internal static JsonValue Of(object value)
        {
            if (value == null) return default(JsonValue);
            if (value is bool) return JsonValue.OfFlag((bool)value);
            if (value is int || value is uint || value is long) return JsonValue.OfInteger(Convert.ToInt64(value));
            if (value is float || value is double) return JsonValue.OfFloat(Convert.ToDouble(value));
            // Hashes are text in the corpus: JSON's numbers lose bits beyond 2^53.
            if (value is ulong) return JsonValue.OfText(((ulong)value).ToString("x16"));
            if (value is string) return JsonValue.OfText((string)value);
            if (value is Vec3)
            {
                var vector = (Vec3)value;
                return List(vector.X, vector.Y, vector.Z);
            }
            if (value is ProtocolVersion) return List(((ProtocolVersion)value).Major, ((ProtocolVersion)value).Minor);
            if (value is HeldRow) return List(((HeldRow)value).Segment, ((HeldRow)value).Xxh3);
            if (value is SegmentFacts) return Of((SegmentFacts)value);
            var numbers = value as KeyValuePair<string, double>[];
            if (numbers != null) return Map(numbers.Select(number => new KeyValuePair<string, object>(number.Key, number.Value)));
            var items = value as Array;
            if (items != null) return JsonValue.OfList(items.Cast<object>().Select(Of).ToArray());
            // By reflection, so that a new field of the protocol is compared without a line here; absent fields are left out.
            return Map(((WirePart)value)
                    .GetType()
                    .GetProperties(BindingFlags.Public | BindingFlags.Instance)
                    .Select(field => new KeyValuePair<string, object>(NameOf(field.Name), field.GetValue(value, null)))
                    .Where(field => field.Value != null));
        }

        private static JsonValue Of(SegmentFacts row)
        {
            Box box = row.Bounds;
            return Map(new[] {
                new KeyValuePair<string, object>("id", row.Segment),
                new KeyValuePair<string, object>("length", row.Length),
                new KeyValuePair<string, object>("xxh3", row.Xxh3),
                new KeyValuePair<string, object>("faces", row.Faces),
                new KeyValuePair<string, object>("vertices", row.Vertices),
                new KeyValuePair<string, object>("bounds", new[] { box.MinX, box.MinY, box.MinZ, box.MaxX, box.MaxY, box.MaxZ }),
            });
        }

        private static JsonValue List(params object[] items) { return JsonValue.OfList(Array.ConvertAll(items, Of)); }

        private static JsonValue Map(IEnumerable<KeyValuePair<string, object>> members)
        {
            KeyValuePair<string, object>[] all = members.ToArray();
            return JsonValue.OfObject(
                new JsonObject(Array.ConvertAll(all, member => member.Key), Array.ConvertAll(all, member => Of(member.Value))));
        }

        /// <summary>RadiusM is radius_m on the wire.</summary>
        private static string NameOf(string property)
        {
            var name = new StringBuilder();
            foreach (char letter in property)
            {
                if (char.IsUpper(letter) && name.Length > 0) name.Append('_');
                name.Append(char.ToLowerInvariant(letter));
            }
            return name.ToString();
        }
    }
}
