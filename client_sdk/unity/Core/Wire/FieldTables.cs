using Terraport.Json;

namespace Terraport.Wire
{
    /// <summary>Fields by their tables: read, checked, written.</summary>
    internal static class FieldTables
    {
        /// <summary>Read the fields of a map; unknown keys are skipped (newer minor versions add some), null is absent.</summary>
        /// <exception cref="RefusedException">With the path of the field that is missing, mistyped or out of range.</exception>
        internal static void Read(WirePart into, JsonValue raw)
        {
            if (raw.Kind != JsonKind.Object) throw new RefusedException("got " + raw.Show() + ", expected a map");
            Field[] fields = into.Fields;
            // Two passes over the fields, as FieldKind says: the first fault by layout is named before any fault by value.
            var layouts = new object[fields.Length];
            var values = new JsonValue[fields.Length];
            for (int number = 0; number < fields.Length; number++)
            {
                Field field = fields[number];
                values[number] = raw[field.Name];
                if (!values[number].IsNull)
                    layouts[number] = Layout(field, values[number]);
                else if (field.IsRequired)
                    throw Missing(field);
            }
            // Values only after all layouts: both sides then name the same field of a message with several faults.
            for (int number = 0; number < fields.Length; number++)
            {
                if (!values[number].IsNull) into.Set(number, Value(fields[number], values[number], layouts[number]));
            }
        }

        /// <summary>Check the value of every field of a map that we are about to send.</summary>
        internal static void Check(WirePart map)
        {
            Field[] fields = map.Fields;
            for (int number = 0; number < fields.Length; number++)
            {
                Field field = fields[number];
                object value = map.Get(number);
                if (value == null)
                {
                    if (field.IsRequired) throw Missing(field);
                    continue;
                }
                try
                {
                    field.Kind.Check(value);
                }
                catch (RefusedException refused)
                {
                    throw refused.Below(field.Name);
                }
            }
        }

        /// <summary>Write checked fields, in the table's order, behind a type where there is one.</summary>
        internal static JsonValue Write(WirePart map, string type)
        {
            Field[] fields = map.Fields;
            var fieldValues = new object[fields.Length];
            // Counted first, so that names and values are allocated once, at their length.
            int count = type == null ? 0 : 1;
            for (int number = 0; number < fields.Length; number++)
            {
                fieldValues[number] = map.Get(number);
                if (fieldValues[number] != null) count++;
            }
            var names = new string[count];
            var values = new JsonValue[count];
            int member = 0;
            if (type != null)
            {
                names[0] = "type";
                values[0] = JsonValue.OfText(type);
                member = 1;
            }
            for (int number = 0; number < fields.Length; number++)
            {
                if (fieldValues[number] == null) continue;
                names[member] = fields[number].Name;
                values[member] = fields[number].Kind.Write(fieldValues[number]);
                member++;
            }
            return JsonValue.OfObject(new JsonObject(names, values));
        }

        private static object Layout(Field field, JsonValue raw)
        {
            try
            {
                return field.Kind.Layout(raw);
            }
            catch (RefusedException refused)
            {
                throw refused.Below(field.Name);
            }
        }

        private static object Value(Field field, JsonValue raw, object layout)
        {
            try
            {
                return field.Kind.Read(raw, layout);
            }
            catch (RefusedException refused)
            {
                throw refused.Below(field.Name);
            }
        }

        private static RefusedException Missing(Field field)
        {
            return new RefusedException("got nothing, expected " + field.Kind.Describe(), field.Name);
        }
    }
}
