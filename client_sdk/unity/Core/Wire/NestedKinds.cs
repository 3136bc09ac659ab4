using System;
using System.Collections.Generic;
using System.Globalization;
using Terraport.Json;

namespace Terraport.Wire
{
    /// <summary>A version: major and minor.</summary>
    internal sealed class VersionKind : FieldKind
    {
        private const int MaxComponent = 65535;

        internal override object Read(JsonValue raw, object layout)
        {
            if (raw.Kind != JsonKind.List || raw.Count != 2) throw Refuse(raw);
            return new ProtocolVersion(Component(raw[0]), Component(raw[1]));
        }

        internal override void Check(object value)
        {
            var version = (ProtocolVersion)value;
            if (version.Major < 0 || version.Major > MaxComponent || version.Minor < 0 || version.Minor > MaxComponent)
            {
                throw Refuse(version.ToString());
            }
        }

        internal override JsonValue Write(object value)
        {
            var version = (ProtocolVersion)value;
            return JsonValue.OfList(new[] { JsonValue.OfInteger(version.Major), JsonValue.OfInteger(version.Minor) });
        }

        internal override string Describe() { return "a version [major, minor]"; }

        private int Component(JsonValue raw)
        {
            long component;
            if (!raw.TryInteger(out component) || component < 0 || component > MaxComponent) throw Refuse(raw);
            return (int)component;
        }
    }

    /// <summary>A list of versions.</summary>
    internal sealed class VersionsKind : FieldKind
    {
        // Kinds hold no state of a message: one serves all.
        private static readonly VersionKind Element = new VersionKind();
        private readonly int maxCount;

        internal VersionsKind(int maxCount) { this.maxCount = maxCount; }

        internal override object Read(JsonValue raw, object layout)
        {
            if (raw.Kind != JsonKind.List || raw.Count > maxCount) throw Refuse(raw);
            var versions = new ProtocolVersion[raw.Count];
            for (int number = 0; number < versions.Length; number++)
            {
                versions[number] = (ProtocolVersion)Element.Read(raw[number], null);
            }
            return versions;
        }

        internal override void Check(object value)
        {
            var versions = (ProtocolVersion[])value;
            if (versions.Length > maxCount) throw Refuse("a list of " + versions.Length);
            foreach (ProtocolVersion version in versions) Element.Check(version);
        }

        internal override JsonValue Write(object value)
        {
            return JsonValue.OfList(Array.ConvertAll((ProtocolVersion[])value, version => Element.Write(version)));
        }

        internal override string Describe() { return "a list of at most " + maxCount + " versions"; }
    }

    /// <summary>A map of names to finite numbers.</summary>
    internal sealed class NumbersKind : FieldKind
    {
        private static readonly TextKind Name = new TextKind(1, 128, null);
        private readonly int maxCount;

        internal NumbersKind(int maxCount) { this.maxCount = maxCount; }

        internal override object Layout(JsonValue raw)
        {
            // First pass: that it is a map at all; names and numbers are values, and belong to the second.
            if (raw.Kind != JsonKind.Object) throw Refuse(raw);
            return null;
        }

        internal override object Read(JsonValue raw, object layout)
        {
            JsonObject members = raw.Members;
            if (members.Count > maxCount) throw Refuse(raw);
            var numbers = new KeyValuePair<string, double>[members.Count];
            for (int index = 0; index < numbers.Length; index++)
            {
                string name = members.NameAt(index);
                Name.Check(name);
                double number;
                // The key is the path below the field, so that an error names the attribute.
                if (!members.ValueAt(index).TryNumber(out number))
                {
                    throw new RefusedException("got " + members.ValueAt(index).Show() + ", expected a finite number", name);
                }
                numbers[index] = new KeyValuePair<string, double>(name, number);
            }
            return numbers;
        }

        internal override void Check(object value)
        {
            var numbers = (KeyValuePair<string, double>[])value;
            if (numbers.Length > maxCount) throw Refuse(numbers.Length.ToString(CultureInfo.InvariantCulture));
            // Read need not look for repeats: a map whose key stands twice is malformed msgpack already.
            var names = new HashSet<string>(StringComparer.Ordinal);
            foreach (KeyValuePair<string, double> number in numbers)
            {
                Name.Check(number.Key);
                if (!names.Add(number.Key)) throw new RefusedException("got a name twice, expected each once", number.Key);
                if (double.IsNaN(number.Value) || double.IsInfinity(number.Value))
                {
                    throw new RefusedException("got " + JsonValue.OfFloat(number.Value).Show() + ", expected a finite number", number.Key);
                }
            }
        }

        internal override JsonValue Write(object value)
        {
            var numbers = (KeyValuePair<string, double>[])value;
            return JsonValue.OfObject(new JsonObject(
                Array.ConvertAll(numbers, number => number.Key), Array.ConvertAll(numbers, number => JsonValue.OfFloat(number.Value))));
        }

        internal override string Describe() { return "a map of at most " + maxCount + " numbers"; }
    }

    /// <summary>A map with fields of its own.</summary>
    internal sealed class PartKind : FieldKind
    {
        private readonly Func<WirePart> create;
        private readonly string name;

        internal PartKind(Func<WirePart> create, string name)
        {
            this.create = create;
            this.name = name;
        }

        internal override object Layout(JsonValue raw)
        {
            // Read whole in the first pass, as a layout: its own fields have passes of their own.
            WirePart map = create();
            FieldTables.Read(map, raw);
            return map;
        }

        internal override object Read(JsonValue raw, object layout) { return layout; }

        internal override void Check(object value) { FieldTables.Check((WirePart)value); }

        internal override JsonValue Write(object value) { return FieldTables.Write((WirePart)value, null); }

        internal override string Describe() { return "a map (" + name + ")"; }
    }

    /// <summary>A list of maps with the same fields.</summary>
    internal sealed class PartsKind : FieldKind
    {
        private readonly Func<WirePart> create;
        private readonly int maxCount;

        internal PartsKind(Func<WirePart> create, int maxCount)
        {
            this.create = create;
            this.maxCount = maxCount;
        }

        internal override object Layout(JsonValue raw)
        {
            // Counted before anything is made of it.
            if (raw.Kind != JsonKind.List || raw.Count > maxCount) throw Refuse(raw);
            var maps = new WirePart[raw.Count];
            for (int number = 0; number < maps.Length; number++)
            {
                maps[number] = create();
                try
                {
                    FieldTables.Read(maps[number], raw[number]);
                }
                catch (RefusedException refused)
                {
                    // Paths of items have their number in them: members.3.role.
                    throw refused.Below(number.ToString(CultureInfo.InvariantCulture));
                }
            }
            return maps;
        }

        internal override object Read(JsonValue raw, object layout) { return layout; }

        internal override void Check(object value)
        {
            var maps = (WirePart[])value;
            if (maps.Length > maxCount) throw Refuse("a list of " + maps.Length);
            for (int number = 0; number < maps.Length; number++)
            {
                try
                {
                    FieldTables.Check(maps[number]);
                }
                catch (RefusedException refused)
                {
                    throw refused.Below(number.ToString(CultureInfo.InvariantCulture));
                }
            }
        }

        internal override JsonValue Write(object value)
        {
            return JsonValue.OfList(Array.ConvertAll((WirePart[])value, map => FieldTables.Write(map, null)));
        }

        internal override string Describe() { return "a list of at most " + maxCount + " maps"; }
    }
}
