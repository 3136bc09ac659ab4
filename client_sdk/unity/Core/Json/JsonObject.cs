using System;
using System.Collections.Generic;

namespace Terraport.Json
{
    /// <summary>The members of an object, each name once, in the order received.</summary>
    public sealed class JsonObject
    {
        private readonly string[] names;
        private readonly JsonValue[] values;

        /// <summary>Make one of names and values side by side; the arrays are kept, not copied.</summary>
        /// <exception cref="ArgumentException">The arrays differ in length.</exception>
        public JsonObject(string[] names, JsonValue[] values)
        {
            if (names.Length != values.Length)
            {
                throw new ArgumentException("got " + names.Length + " names and " + values.Length + " values, expected as many");
            }
            this.names = names;
            this.values = values;
        }

        /// <summary>Number of members.</summary>
        public int Count => names.Length;

        /// <summary>Name of a member, by its index in the order received.</summary>
        public string NameAt(int index) { return names[index]; }

        /// <summary>Value of a member, by its index in the order received.</summary>
        public JsonValue ValueAt(int index) { return values[index]; }

        /// <summary>Look a member up; false where there is none of that name. Takes time in proportion to the members.</summary>
        public bool TryGet(string name, out JsonValue value)
        {
            for (int index = 0; index < names.Length; index++)
            {
                if (string.Equals(names[index], name, StringComparison.Ordinal))
                {
                    value = values[index];
                    return true;
                }
            }
            value = default(JsonValue);
            return false;
        }

        /// <summary>A name that stands twice; null where each stands once. Long lists are sorted, so that no choice of
        /// names makes this slow.</summary>
        internal static string FirstRepeated(List<string> list, int start)
        {
            int count = list.Count - start;
            // Nearly every object: comparing pairs is faster than sorting, and allocates nothing.
            if (count <= 16)
            {
                for (int candidate = start + 1; candidate < list.Count; candidate++)
                {
                    for (int earlier = start; earlier < candidate; earlier++)
                    {
                        if (string.Equals(list[candidate], list[earlier], StringComparison.Ordinal)) return list[candidate];
                    }
                }
                return null;
            }
            var sorted = new string[count];
            list.CopyTo(start, sorted, 0, count);
            Array.Sort(sorted, StringComparer.Ordinal);
            for (int index = 1; index < count; index++)
            {
                if (string.Equals(sorted[index], sorted[index - 1], StringComparison.Ordinal)) return sorted[index];
            }
            return null;
        }
    }
}
