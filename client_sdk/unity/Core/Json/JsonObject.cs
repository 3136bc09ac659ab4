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

        /// <summary>Name of a member, by its place.</summary>
        public string NameAt(int place) { return names[place]; }

        /// <summary>Value of a member, by its place.</summary>
        public JsonValue ValueAt(int place) { return values[place]; }

        /// <summary>Look a member up; false where there is none of that name. Takes time in proportion to the members.</summary>
        public bool TryGet(string name, out JsonValue value)
        {
            for (int place = 0; place < names.Length; place++)
            {
                if (string.Equals(names[place], name, StringComparison.Ordinal))
                {
                    value = values[place];
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
            if (count <= 16)
            {
                for (int one = start + 1; one < list.Count; one++)
                {
                    for (int other = start; other < one; other++)
                    {
                        if (string.Equals(list[one], list[other], StringComparison.Ordinal)) return list[one];
                    }
                }
                return null;
            }
            var sorted = new string[count];
            list.CopyTo(start, sorted, 0, count);
            Array.Sort(sorted, StringComparer.Ordinal);
            for (int place = 1; place < count; place++)
            {
                if (string.Equals(sorted[place], sorted[place - 1], StringComparison.Ordinal)) return sorted[place];
            }
            return null;
        }
    }
}
