using System;
using System.Collections.Generic;

namespace Terraport.Json
{
    /// <summary>
    /// Values of a JSON text, whose one parser is <see cref="JsonTape"/>. Beyond what that refuses, a key must not stand twice.
    /// </summary>
    /// <remarks>
    /// Nesting is bounded, so no text can exhaust the stack; the number of values is bounded, so no text takes more memory than
    /// a few times its own size.
    /// </remarks>
    public sealed class JsonReader
    {
        /// <summary>Values and keys of one text that are read unless another bound is given.</summary>
        public const int DefaultMaxValues = 1 << 22;

        private readonly JsonTape tape = new JsonTape();
        // A stack shared by all nesting levels: each object pushes its keys and takes them off when it is complete.
        private readonly List<string> names = new List<string>();

        private JsonReader(ArraySegment<byte> text, int maxValues) { tape.Read(text.Array, text.Offset, text.Count, maxValues); }

        /// <summary>Read a text that is exactly one value of JSON.</summary>
        /// <param name="text">The text as UTF-8.</param>
        /// <param name="maxValues">Values and keys in all at most.</param>
        /// <exception cref="JsonException">It is not exactly one value of JSON, or beyond a bound.</exception>
        public static JsonValue Read(ArraySegment<byte> text, int maxValues = DefaultMaxValues)
        {
            if (text.Array == null) throw new ArgumentNullException("text");
            try
            {
                return new JsonReader(text, maxValues).Value(0);
            }
            catch (JsonException error)
            {
                // The tape counts from the start of the array; callers count from the start of their text.
                throw new JsonException(error.Reason, error.Offset - text.Offset);
            }
        }

        // Recursion is safe here: the tape has refused anything nested more than 64 deep.
        private JsonValue Value(int node)
        {
            switch (tape.KindOf(node))
            {
                case JsonNodeKind.Object: return Object(node);
                case JsonNodeKind.List: return List(node);
                case JsonNodeKind.Text: return JsonValue.OfText(tape.TextOf(node));
                case JsonNodeKind.Number: return tape.WholeOrFloat(node);
                case JsonNodeKind.True: return JsonValue.OfFlag(true);
                case JsonNodeKind.False: return JsonValue.OfFlag(false);
                default: return default(JsonValue);
            }
        }

        private JsonValue List(int list)
        {
            var values = new JsonValue[tape.CountOf(list)];
            int node = tape.FirstOf(list);
            for (int index = 0; index < values.Length; index++)
            {
                values[index] = Value(node);
                node = tape.After(node);
            }
            return JsonValue.OfList(values);
        }

        private JsonValue Object(int owner)
        {
            var values = new JsonValue[tape.CountOf(owner)];
            int firstName = names.Count;
            int node = tape.FirstOf(owner);
            for (int index = 0; index < values.Length; index++)
            {
                names.Add(tape.TextOf(node));
                int value = tape.After(node);
                values[index] = Value(value);
                node = tape.After(value);
            }
            // The tape takes the last of a repeated key; a value refuses it, since nobody writes one on purpose.
            string repeated = JsonObject.FirstRepeated(names, firstName);
            if (repeated != null)
            {
                string quoted = JsonValue.ShowText(repeated);
                throw new JsonException("got key " + quoted + " twice, expected each key once", tape.StartOf(owner));
            }
            string[] objectNames = names.GetRange(firstName, values.Length).ToArray();
            names.RemoveRange(firstName, values.Length);
            return JsonValue.OfObject(new JsonObject(objectNames, values));
        }
    }
}
